"""Text of users in pictures."""

from __future__ import annotations


def plain(text: str) -> str:
    """Keep matplotlib from reading names between dollar signs as formulas, which may fail."""
    return text.replace('$', r'\$')
