"""Layers of a scene, peeled or cut into slabs, seen from the lens centre."""

from focusjax.layers._build import disparity_map as disparity_map
from focusjax.layers._build import first_surfaces as first_surfaces
from focusjax.layers._build import peel as peel
from focusjax.layers._cells import BELOW_MOST as BELOW_MOST
from focusjax.layers._cells import covered as covered
from focusjax.layers._cells import interval as interval
from focusjax.layers._extent import Extent as Extent
from focusjax.layers._gloss import GlossSamples as GlossSamples
from focusjax.layers._gloss import unpack_normal as unpack_normal
from focusjax.layers._grid import Grid as Grid
from focusjax.layers._joins import NEIGHBOURS as NEIGHBOURS
from focusjax.layers._joins import SAME_LAYER as SAME_LAYER
from focusjax.layers._joins import UNJOINED as UNJOINED
from focusjax.layers._layers import Layers as Layers
from focusjax.layers._layers import Samples as Samples
from focusjax.layers._layers import spread as spread
from focusjax.layers._memory import check_held as check_held
from focusjax.layers._missed import MissedLight as MissedLight
from focusjax.layers._missed import NearestSurface as NearestSurface
from focusjax.layers._missed import missed_light as missed_light
from focusjax.layers._places import Places as Places
from focusjax.layers._pyramid import RangePyramid as RangePyramid
from focusjax.layers._saving import UmbraSaving as UmbraSaving
from focusjax.layers._saving import umbra_saving as umbra_saving
from focusjax.layers._slabs import decompose as decompose
from focusjax.layers._slopes import radiance_slopes as radiance_slopes
