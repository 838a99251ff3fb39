"""Property tests run without a deadline: the first call of a kernel compiles it."""

from hypothesis import settings

settings.register_profile("deform", deadline=None, max_examples=50)
settings.load_profile("deform")
