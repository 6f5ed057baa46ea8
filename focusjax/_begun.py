"""When this process took up the first source of focusjax."""

import time

BEGUN = time.time()
