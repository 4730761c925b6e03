"""`python -m hrclog`."""

import sys

from hrclog.cli import main

sys.exit(main())
