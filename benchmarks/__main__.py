# SPDX-License-Identifier: MIT
"""`python -m benchmarks run SUITE`: one runner for all benchmarks."""

from benchmarks.run import main

if __name__ == "__main__":
    main()
