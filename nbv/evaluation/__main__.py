# SPDX-License-Identifier: MIT
"""`python -m nbv.evaluation`: completion against the truth and naive baselines, as a page."""

from nbv.evaluation.command import main

if __name__ == "__main__":
    main()
