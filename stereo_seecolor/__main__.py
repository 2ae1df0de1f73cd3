"""``python -m stereo_seecolor``: the command line."""

from stereo_seecolor.cli import main

if __name__ == "__main__":
    main()
