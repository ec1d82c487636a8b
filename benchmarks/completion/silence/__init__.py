# SPDX-License-Identifier: MIT
"""What brings nothing back: scenes before a simulated Kinect, and what completion makes of its holes."""
