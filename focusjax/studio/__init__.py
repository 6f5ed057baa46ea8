"""A page to point at what should be sharp, with the lens and the picture beside it."""

from focusjax.studio._answer import Answer as Answer
from focusjax.studio._answer import Under as Under
from focusjax.studio._command import command as command
from focusjax.studio._document import Document as Document
from focusjax.studio._document import EditError as EditError
from focusjax.studio._session import Session as Session
from focusjax.studio._studio import Studio as Studio
