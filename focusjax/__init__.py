"""Say what should be sharp; get the lens settings and the picture."""
