"""Scenes: meshes, materials and textures, lights, backgrounds, and the radiance of surfaces."""

from focusjax.scene._background import AbstractBackground as AbstractBackground
from focusjax.scene._background import ConstantBackground as ConstantBackground
from focusjax.scene._background import GradientBackground as GradientBackground
from focusjax.scene._background import ImageBackground as ImageBackground
from focusjax.scene._background import constant_background as constant_background
from focusjax.scene._background import gradient_background as gradient_background
from focusjax.scene._background import image_background as image_background
from focusjax.scene._gloss import Gloss as Gloss
from focusjax.scene._images import read_image as read_image
from focusjax.scene._lights import AbstractLight as AbstractLight
from focusjax.scene._lights import DirectionalLight as DirectionalLight
from focusjax.scene._lights import PointLight as PointLight
from focusjax.scene._lights import directional_light as directional_light
from focusjax.scene._lights import point_light as point_light
from focusjax.scene._load import load_mesh as load_mesh
from focusjax.scene._material import Material as Material
from focusjax.scene._object import SceneObject as SceneObject
from focusjax.scene._object import make_object as make_object
from focusjax.scene._opacity import Opacity as Opacity
from focusjax.scene._placement import placement as placement
from focusjax.scene._scene import Scene as Scene
from focusjax.scene._scene import make_scene as make_scene
from focusjax.scene._shader import Shader as Shader
from focusjax.scene._sizes import gltf_json as gltf_json
