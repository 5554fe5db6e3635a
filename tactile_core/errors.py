"""The one exception that users meet: it names what is wrong, where, and what to do."""


class TactileError(ValueError):
    """Bad input or settings. The message is one line that a user can act on."""


class DamagedError(TactileError):
    """A file that an asset stored is gone, or other bytes than it wrote: materialise it again."""
