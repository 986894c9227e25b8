"""Messages that never came: gaps in the numbers that the middleware gives them."""

from __future__ import annotations


class LossCount:
    """Counts what one subscription has missed since its first message.

    Attributes
    ----------
    lost
        Messages that were sent and never came. Nothing is counted while several publish: their
        numbers can't be told apart.
    """

    def __init__(self) -> None:
        self.lost = 0
        self._next: int | None = None

    def note(self, sequence: int | None, publishers: int) -> None:
        """Take a message's publication sequence number (None: the middleware gives none)."""
        if sequence is None or publishers != 1:
            self._next = None
            return
        if self._next is not None and sequence > self._next:
            self.lost += sequence - self._next
        self._next = sequence + 1
