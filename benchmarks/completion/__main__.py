# SPDX-License-Identifier: MIT
"""`python -m benchmarks.completion`: completion against the truth and naive baselines, as a page."""

from benchmarks.completion.command import main

if __name__ == "__main__":
    main()
