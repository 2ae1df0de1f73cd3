"""Counted nouns in messages."""


def counted(number: int, noun: str) -> str:
    """Write a number with its noun: ``1 pair``, ``3 pairs``. noun: in the singular, alone or before more words: ``file without a
    partner``.
    """
    first, _, rest = noun.partition(" ")
    return f"{number} {first}{'' if number == 1 else 's'} {rest}".rstrip()
