"""What a run leaves behind for people and programs to read."""

from focusjax._settings import angle as angle
from focusjax._settings import f_number as f_number
from focusjax._settings import metres as metres
from focusjax.report._close_focus import close_focus_facts as close_focus_facts
from focusjax.report._close_focus import close_focus_sentence as close_focus_sentence
from focusjax.report._glass import glass_facts as glass_facts
from focusjax.report._glass import glass_sentences as glass_sentences
from focusjax.report._quality import quality_facts as quality_facts
from focusjax.report._quality import quality_sentence as quality_sentence
from focusjax.report._save import FILES as FILES
from focusjax.report._save import data_url as data_url
from focusjax.report._save import import_drawing as import_drawing
from focusjax.report._save import save_outcome as save_outcome
from focusjax.report._save import title_of as title_of
from focusjax.report._summary import guessed_sentence as guessed_sentence
from focusjax.report._summary import left_out as left_out
from focusjax.report._summary import movements as movements
from focusjax.report._summary import status as status
from focusjax.report._summary import summary as summary
from focusjax.report._summary import versions as versions
