"""Charts of real lenses, and the command that draws them."""

from focusjax.charts._command import FILES as FILES
from focusjax.charts._command import command as command
from focusjax.charts._command import draw_lens as draw_lens
