# SPDX-License-Identifier: MIT
"""Run by FreeCAD: open a STEP file, list its bodies and features with the colours of faces, save a picture.

`STEP=part.features.step PNG=part.png xvfb-run freecad freecad_step.py`
"""

import os
import sys
from collections import Counter

import FreeCAD
import FreeCADGui
import ImportGui

ImportGui.open(os.environ["STEP"])
for thing in FreeCAD.ActiveDocument.Objects:
    if thing.TypeId == "Part::Feature":
        faces = Counter(
            tuple(round(one, 2) for one in colour[:3]) for colour in thing.ViewObject.DiffuseColor
        )
        volume = f"{thing.Shape.Volume / 1000:.2f} cm3" if thing.Shape.Solids else "no solid"
        counts = f"{len(thing.Shape.Faces)} faces, {volume}, valid {thing.Shape.isValid()}"
        print(f"{thing.Label}: {counts}, colours {dict(faces)}")
view = FreeCADGui.ActiveDocument.ActiveView
view.viewIsometric()
view.fitAll()
view.saveImage(os.environ["PNG"], 1000, 700, "White")
sys.stdout.flush()
os._exit(0)  # without the window's question to save
