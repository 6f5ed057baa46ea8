"""From linear light to what a screen shows."""

from focusjax.film._display import encode_srgb as encode_srgb
from focusjax.film._display import expose as expose
from focusjax.film._display import to_bytes as to_bytes
from focusjax.film._display import to_words as to_words
