"""Try many settings of a focus problem, and rank them by how well they meet the wishes.

The same as `focusjax batch`, from Python: take it as a start for searches of your own. Every combination of
the `--grid` values, or every row of the `--table`, is solved for its lens (`--render` makes the pictures
too), into a folder of its own under `--out`, which also gets summary.csv, summary.json and summary.html. A
second call with the same folder goes on where the first was stopped.

    python scripts/batch_optimize.py configs/still_life.toml --grid 'focus.1.blur_px=[10, 20, 30]' \
        --grid 'solve.f_number_min=[1.4, 2.8]' --out out/search --jobs 2
"""

import sys

from _command_line import make_parser

from focusjax.batch import BatchError, ItemResult, make_items, parse_grid, run_batch
from focusjax.config import ConfigError


def report(result: ItemResult) -> None:
    """A line as soon as an item has ended."""
    print(f"{result.status:7} {result.item.name} {result.message}", flush=True)


def main() -> int:
    parser = make_parser(__doc__)
    parser.add_argument("configs", nargs="+", metavar="CONFIG", help="TOML files")
    parser.add_argument("--grid", action="append", default=[], metavar="KEY=[VALUE,...]")
    parser.add_argument("--table", metavar="CSV", help="a row for each item, with keys as columns")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="for all items")
    parser.add_argument("--out", required=True, help="folder for the results")
    parser.add_argument("--jobs", type=int, default=1, help="processes that share the work")
    parser.add_argument("--render", action="store_true", help="make the pictures too")
    arguments = parser.parse_args()

    # Any list of items will do: change this to your own search.
    try:
        items = make_items(
            arguments.configs,
            grid=parse_grid(arguments.grid),
            table=arguments.table,
            overrides=arguments.set,
        )
        batch = run_batch(
            items,
            arguments.out,
            workers=arguments.jobs,
            existing="resume",
            solve_only=not arguments.render,
            on_result=report,
            on_note=print,
        )
    except (BatchError, ConfigError) as error:
        parser.error(str(error))

    print("\nBest first:")
    for result in sorted(batch.having("done"), key=lambda result: result.worst_error):
        lens = result.facts["lens"]
        print(
            f"{result.worst_error:9.2f} px  f/{float(lens['f_number']):<6.3g}"
            f" {float(lens['focus_distance_m']):8.3f} m  {result.item.name}"
        )
    for result in batch.failed:
        print(f"{result.item.name} failed: {result.message}", file=sys.stderr)
    return 1 if batch.failed else 0


# Processes that share the work read this file again: nothing may start outside of main.
if __name__ == "__main__":
    sys.exit(main())
