# SPDX-License-Identifier: MIT
"""All bad files, tried: `python -m tests.robustness.bad_files`; `--write` puts them into
docs/results/robustness.md.

Any other words pick the cases whose title holds them.
"""

import sys

from tests.robustness.bad_files.table import counted, write
from tests.robustness.bad_files.trial import all_cases, tried_apart, try_all

if __name__ == "__main__":
    if sys.argv[1:] == ["--write"]:
        write(counted(all_cases(), tried_apart()))
    else:
        try_all(" ".join(sys.argv[1:]))
