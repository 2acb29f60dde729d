"""`python -m sitl_mocks`."""

import sys

from sitl_mocks.command_line import main

if __name__ == "__main__":
    sys.exit(main())
