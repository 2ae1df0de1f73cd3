"""The arguments of the benchmarks that take a few words."""

import argparse


def words_of(documentation: str | None, names: str = "") -> list[str]:
    """The words after a benchmark's name. ``--help`` prints its documentation, and what the words
    are.
    """
    parser = argparse.ArgumentParser(
        description=documentation, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    if names:
        parser.add_argument("words", nargs="*", metavar=names, help="see above")
    return vars(parser.parse_args()).get("words", [])
