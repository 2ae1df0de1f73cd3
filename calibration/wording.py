"""Numbers of things in sentences."""


def counted(number: int, noun: str) -> str:
    """``1 pair``, ``3 pairs``. noun: in the singular, alone or before more words: ``file without a partner``."""
    first, _, rest = noun.partition(" ")
    return f"{number} {first}{'' if number == 1 else 's'} {rest}".rstrip()
