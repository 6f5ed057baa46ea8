"""Whether a picture is traced or post-processed, where its quality is to decide."""

from dataclasses import dataclass

from focusjax.config import RenderTable
from focusjax.layers import Layers
from focusjax.lens import AbstractLens
from focusjax.post import PinholeView, PostPlan, plan_post
from focusjax.trace import RayPlan, plan_rays


@dataclass(frozen=True)
class Way:
    """How a picture of a wanted quality is made, and what was expected.

    Attributes:
        traced: of rays; None where none were planned, as even the fewest would take longer than
            post-processing.
        post: of post-processing; None where it was not to be considered.
        by_post: whether that is taken.
    """

    traced: RayPlan | None
    post: PostPlan | None = None
    by_post: bool = False


def choose_way(table: RenderTable, view: PinholeView | None, layers: Layers, lens: AbstractLens) -> Way:
    """The quicker of the ways that reach the quality of `table`.

    Rays are planned only where they are of use: not if post-processing is expected to reach the quality in
    less time than the fewest rays take.

    Args:
        table: with a quality.
        view: what a pinhole sees; None where only tracing is to be considered.
        layers: peeled for the lens.
        lens: any lens.

    Raises:
        ValueError: as `plan_rays`.
    """
    assert table.quality is not None
    post = None if view is None else plan_post(view, layers, lens, table.quality, seed=table.seed)
    if post is not None and post.reaches and post.seconds < post.fewest_seconds:
        return Way(None, post, by_post=True)
    traced = plan_rays(layers, lens, table.quality, smooth=table.smooth, seed=table.seed)
    return Way(traced, post, by_post=post is not None and post.reaches and post.seconds < traced.seconds)
