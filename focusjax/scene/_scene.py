"""A whole scene on the host: all triangles in one list, with lights and surroundings."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from focusjax._arguments import require_kind, require_switches
from focusjax._device import device_array
from focusjax._kept import kept
from focusjax._words import did_you_mean
from focusjax.scene._atlas import atlas_of, make_atlas
from focusjax.scene._background import AbstractBackground, constant_background
from focusjax.scene._gloss import Gloss
from focusjax.scene._lights import AbstractLight, light_colour
from focusjax.scene._material import Material
from focusjax.scene._object import SceneObject
from focusjax.scene._opacity import Opacity, OpacityPictures, cutoff_code, opacity_levels
from focusjax.scene._shader import Shader, Texturing


@dataclass(frozen=True)
class Scene:
    """Triangles in world metres, how they answer light, the lights, and the background.

    Attributes:
        vertices: world metres [v, 3].
        faces: vertex numbers [t, 3].
        normals: unit shading normals [v, 3].
        uv: texture coordinates [v, 2], v upwards.
        colours: linear vertex colours [v, 3].
        face_material: material number of each face [t].
        materials: what the numbers mean.
        textures: linear pictures [h, w, 3] the materials refer to.
        opacities: opacity pictures [h, w] the materials refer to.
        vertex_opacity: 0 to 1 [v]; None where all are 1.
        objects: the faces of each object by name, in the order given.
        lights: directional and point lights.
        ambient: linear light [3] that a white surface reflects whichever way it faces.
        unlit: show albedo and emission without any lights.
        background: radiance from infinity.

    Example:
        >>> wall = fj.make_object("wall", [(-9, -9, -2), (9, -9, -2), (0, 9, -2)], [(0, 1, 2)])
        >>> scene = fj.make_scene([wall], lights=[fj.point_light((0, 0, 0))])
        >>> scene, scene.face_range("wall")
        (Scene(1 triangles of wall; 1 lights), range(0, 1))
    """

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "t 3"]
    normals: Float[np.ndarray, "v 3"]
    uv: Float[np.ndarray, "v 2"]
    colours: Float[np.ndarray, "v 3"]
    face_material: Int[np.ndarray, "t"]
    materials: tuple[Material, ...]
    textures: tuple[Float[np.ndarray, "_ _ 3"], ...]
    opacities: tuple[Float[np.ndarray, "_ _"], ...]
    vertex_opacity: Float[np.ndarray, "v"] | None
    objects: dict[str, range]
    lights: tuple[AbstractLight, ...]
    ambient: Float[np.ndarray, "3"]
    unlit: bool
    background: AbstractBackground

    def __repr__(self) -> str:
        named = ", ".join(self.objects)
        return f"Scene({len(self.faces)} triangles of {named}; {len(self.lights)} lights)"

    def face_range(self, name: str) -> range:
        """The faces of the object `name`.

        Raises:
            ValueError: there is no such object; the message suggests the nearest name.
        """
        if name not in self.objects:
            names = list(self.objects)
            hint = did_you_mean(name, names, f"the scene has {', '.join(map(repr, names))}")
            raise ValueError(f"there is no object named {name!r}; {hint}")
        return self.objects[name]

    def gloss(self) -> Gloss | None:
        """What depends on where the surfaces are seen from; None when all of them are matt or unlit."""

        def planes(field: str) -> tuple[Float[Array, "_"], ...] | None:
            values = np.stack([getattr(material, field) for material in self.materials])
            # What is grey in all materials is looked up once, not three times.
            columns = values.T[:1] if (values == values[:, :1]).all() else values.T
            return tuple(device_array(column, dtype=float) for column in columns) if values.any() else None

        specular = planes("specular") if self.lights else None
        reflectance = planes("reflectance")
        if self.unlit or (specular is None and reflectance is None):
            return None
        return Gloss(
            specular=specular,
            shininess=jnp.asarray([material.shininess for material in self.materials], dtype=float),
            reflectance=reflectance,
            lights=() if specular is None else self.lights,
            background=None if reflectance is None else self.background,
        )

    def may_be_seen_through(self) -> Bool[np.ndarray, "t"] | None:
        """Which faces may not be opaque all over; None where every face is."""
        faces = np.array([m.opacity < 1.0 or m.opacity_texture >= 0 for m in self.materials])[
            self.face_material
        ]
        if self.vertex_opacity is not None:
            faces |= (self.vertex_opacity < 1.0)[self.faces].any(axis=1)
        return faces if faces.any() else None

    def opacity(self) -> Opacity:
        """How much of each surface is there; of use where `may_be_seen_through` is not None."""
        pictures = None
        if any(material.opacity_texture >= 0 for material in self.materials):
            pictures = self._opacity_pictures()
        return Opacity(
            faces=tuple(device_array(corner, dtype=jnp.int32) for corner in self.faces.T),
            face_material=device_array(self.face_material, dtype=jnp.int32),
            factor=jnp.asarray([material.opacity for material in self.materials], dtype=float),
            vertex=None if self.vertex_opacity is None else jnp.asarray(self.vertex_opacity, dtype=float),
            pictures=pictures,
        )

    def _opacity_pictures(self) -> OpacityPictures:
        # A picture with its cutoff is kept once, whatever the number of materials that share it.
        kinds = [(m.opacity_texture, m.cutoff) for m in self.materials]
        pictured = list(dict.fromkeys(kind for kind in kinds if kind[0] >= 0))
        opaque = [np.ones((1, 1, 1), dtype=np.float32)]
        atlas = atlas_of([opaque, *(opacity_levels(self.opacities[k], cutoff) for k, cutoff in pictured)])
        sizes = [self.opacities[k].shape if k >= 0 else (0, 0) for k, _ in kinds]
        return OpacityPictures(
            atlas=atlas,
            texture=device_array([pictured.index(k) + 1 if k[0] >= 0 else 0 for k in kinds], dtype=jnp.int32),
            cutoff=jnp.asarray([cutoff_code(cutoff) for _, cutoff in kinds], dtype=float),
            uv=tuple(device_array(column, dtype=float) for column in self.uv.T),
            texels_per_metre=device_array(_texel_density(self, sizes), dtype=float),
        )

    def shader(self, eye: ArrayLike | Sequence[float]) -> Shader:
        """The shader of this scene for a camera at `eye` (world metres)."""
        # Its tables do not depend on the eye, but on the type that numbers have in compiled programs.
        real = jnp.zeros(()).dtype
        return replace(kept(self, ("shader", real), self._shader), eye=device_array(eye, dtype=real))

    def _shader(self) -> Shader:
        """The same for an eye at the origin."""

        def planes(rows: np.ndarray) -> tuple[Float[Array, "_"], ...]:
            return tuple(device_array(column, dtype=float) for column in rows.T)

        def materials(field: str) -> tuple[Float[Array, "_"], ...]:
            return planes(np.stack([getattr(material, field) for material in self.materials]))

        def used(field: str) -> bool:
            return any(np.any(getattr(material, field)) for material in self.materials)

        texturing = None
        if any(material.texture >= 0 for material in self.materials):
            sizes = [self.textures[m.texture].shape[:2] if m.texture >= 0 else (0, 0) for m in self.materials]
            texturing = Texturing(
                atlas=make_atlas(self.textures),
                # The atlas has a white picture at 0 for materials that have none.
                texture=device_array([material.texture + 1 for material in self.materials], dtype=jnp.int32),
                uv=planes(self.uv),
                texels_per_metre=device_array(_texel_density(self, sizes), dtype=float),
                pixels=device_array([m.pixels for m in self.materials]) if used("pixels") else None,
            )
        return Shader(
            faces=tuple(device_array(corner, dtype=jnp.int32) for corner in self.faces.T),
            positions=planes(self.vertices),
            normals=None if self.unlit else planes(self.normals),
            colours=planes(self.colours) if (self.colours != 1.0).any() else None,
            face_material=device_array(self.face_material, dtype=jnp.int32),
            base_colour=materials("base_colour"),
            emission=materials("emission") if used("emission") else None,
            gloss=self.gloss(),
            texturing=texturing,
            lights=() if self.unlit else self.lights,
            ambient=device_array(self.ambient, dtype=float),
            eye=device_array(np.zeros(3)),
        )


def make_scene(
    objects: Sequence[SceneObject],
    *,
    lights: Sequence[AbstractLight] = (),
    ambient: ArrayLike | Sequence[float] = 0.0,
    background: AbstractBackground | None = None,
    unlit: bool = False,
) -> Scene:
    """Join `objects` to a scene.

    Args:
        objects: at least one, of different names.
        lights: directional and point lights.
        ambient: linear light from everywhere; one number or three.
        background: radiance where nothing is; black by default.
        unlit: show albedo and emission without any lights.

    Raises:
        ValueError: no objects, two of the same name, or a negative ambient light.

    Example:
        >>> wall = fj.make_object("wall", [(-9, -9, -2), (9, -9, -2), (0, 9, -2)], [(0, 1, 2)])
        >>> card = fj.make_object("card", [(0, 0, -1), (1, 0, -1), (0, 1, -1)], [(0, 1, 2)])
        >>> scene = fj.make_scene([wall, card], lights=[fj.directional_light((0, 0, -1))], ambient=0.1)
        >>> scene.vertices.shape, list(scene.objects)
        ((6, 3), ['wall', 'card'])
    """
    usage = "make_scene(objects, lights=, background=)"
    for name, values, kind, remedy in (
        ("objects", objects, SceneObject, "`make_object` and `load_mesh` make one"),
        ("lights", lights, AbstractLight, "`directional_light` and `point_light` make one"),
    ):
        require_kind(values, Sequence, usage, "a list of them", name)
        for value in values:
            require_kind(value, kind, usage, remedy, f"one of {name}")
    if background is not None:
        remedy = "`constant_background`, `gradient_background` and `image_background` make one"
        require_kind(background, AbstractBackground, usage, remedy, "background")
    require_switches(unlit=unlit)
    if not objects:
        raise ValueError("the scene has no objects; expected at least one mesh")
    ranges: dict[str, range] = {}
    gathered: dict[str, list[np.ndarray]] = {
        key: [] for key in ("vertices", "faces", "normals", "uv", "colours", "face_material")
    }
    materials: list[Material] = []
    textures: list[np.ndarray] = []
    opacities: list[np.ndarray] = []
    vertex_count = face_count = 0
    for item in objects:
        if item.name in ranges:
            raise ValueError(f"two objects are named {item.name!r}; give each its own name")
        ranges[item.name] = range(face_count, face_count + len(item.faces))
        for key in ("vertices", "normals", "uv", "colours"):
            gathered[key].append(getattr(item, key))
        gathered["faces"].append(item.faces + vertex_count)
        gathered["face_material"].append(item.face_material + len(materials))
        numbers = [
            {number: _place_of(picture, known) for number, picture in enumerate(own)}
            for own, known in ((item.textures, textures), (item.opacities, opacities))
        ]
        materials += [material.renumbered(*numbers) for material in item.materials]
        vertex_count += len(item.vertices)
        face_count += len(item.faces)
    joined = {key: np.concatenate(values) for key, values in gathered.items()}
    return Scene(
        vertices=joined["vertices"],
        faces=joined["faces"].astype(np.int32),
        normals=joined["normals"],
        uv=joined["uv"],
        colours=joined["colours"],
        face_material=joined["face_material"].astype(np.int32),
        materials=tuple(materials),
        textures=tuple(textures),
        opacities=tuple(opacities),
        vertex_opacity=_joined_opacity(objects),
        objects=ranges,
        lights=tuple(lights),
        ambient=np.asarray(light_colour(ambient, "ambient light"), dtype=np.float64),
        unlit=unlit,
        background=constant_background() if background is None else background,
    )


def _place_of(picture: np.ndarray, known: list[np.ndarray]) -> int:
    """The number of a picture among those known, to which it is added if no object had it before."""
    for number, other in enumerate(known):
        if other is picture:
            return number
    known.append(picture)
    return len(known) - 1


def _joined_opacity(objects: Sequence[SceneObject]) -> Float[np.ndarray, "v"] | None:
    """The opacity of all vertices, if any object has some."""
    if all(item.vertex_opacity is None for item in objects):
        return None
    parts = [
        np.ones(len(item.vertices)) if item.vertex_opacity is None else item.vertex_opacity
        for item in objects
    ]
    return np.concatenate(parts)


def _texel_density(scene: Scene, sizes: Sequence[tuple[int, ...]]) -> Float[np.ndarray, "t"]:
    """Texels per metre of each face, from the areas in the texture and in the world.

    `sizes` are the height and width of each material's picture.

    Zero, which means the finest level, for faces without area or without texture.
    """
    corners, uv = scene.vertices[scene.faces], scene.uv[scene.faces]
    across, along = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = np.linalg.norm(np.cross(across, along), axis=1)
    u, v = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    texels = np.array([float(height * width) for height, width in sizes])[scene.face_material]
    covered = np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) * texels
    return np.sqrt(np.where(area > 0.0, covered / np.where(area > 0.0, area, 1.0), 0.0))
