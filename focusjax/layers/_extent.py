"""How large layers are: what the programs that are compiled for them depend on."""

import dataclasses

from focusjax.geometry import Camera
from focusjax.layers._grid import Grid


@dataclasses.dataclass(frozen=True)
class Extent:
    """Sizes of layers, for others to be made `like` them.

    Attributes:
        grid: the sample grid, with the margin that is the least.
        count: number of layers.
        room: samples that there is room for.
    """

    grid: Grid
    count: int
    room: int

    def serves(self, camera: Camera, supersampling: int) -> bool:
        """Whether layers of this frame can be like these."""
        grid = self.grid
        frame = camera.width, camera.height, supersampling
        return (grid.width, grid.height, grid.supersampling) == frame

    def for_others(self, before: "Extent | None") -> "Extent":
        """An extent for layers of other lenses, with more layers and room than these need, and no margin.

        Empty layers and room change nothing in a picture. A margin moves the grid, and with it the rounding
        of positions: each picture is to have its own, whatever came before it.

        Args:
            before: what this returned before; it is kept where it is enough.
        """
        count, room = self.count + 2, 2 * self.room
        if before is not None:
            count = before.count if self.count <= before.count else count
            room = before.room if self.room <= before.room else room
        return Extent(dataclasses.replace(self.grid, margin=0), count, room)
