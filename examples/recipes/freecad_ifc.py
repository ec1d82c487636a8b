# SPDX-License-Identifier: MIT
"""Run by FreeCAD 0.20: open an IFC file, colour its elements by what was measured, save a picture.

`IFC=completed.ifc PNG=model.png IFCOPENSHELL=FOLDER xvfb-run freecad freecad_ifc.py`
"""

import os
import sys
from collections import Counter

sys.path.insert(0, os.environ["IFCOPENSHELL"])
import FreeCAD
import FreeCADGui
import ifcopenshell.geom as geom
import importIFC

STATES = {"measured": (0.8, 0.8, 0.78), "partly": (0.55, 0.7, 0.95), "inferred": (0.15, 0.35, 0.9)}


class Settings(geom.settings):
    """Settings of ifcopenshell 0.8 by their names of 0.7, which FreeCAD 0.20 uses."""

    def __getattr__(self, name):
        return name if name.isupper() else super().__getattr__(name)

    def set(self, name, value):
        """Set a value, of those that there still are."""
        if name == "USE_BREP_DATA":
            super().set("iterator-output", geom.ifcopenshell_wrapper.SERIALIZED)
        elif name not in ("SEW_SHELLS", "INCLUDE_CURVES"):
            super().set(name, value)


geom.settings = Settings
arch = FreeCAD.ParamGet("User parameter:BaseApp/Preferences/Mod/Arch")
arch.SetInt("ifcImportModeArch", 1)  # shapes as they are; 0 would extrude walls that are surfaces
document, counts = importIFC.open(os.environ["IFC"]), Counter()
for thing in document.Objects:
    kind = getattr(thing, "IfcType", "")
    properties = getattr(thing, "IfcProperties", {})
    state = properties.get("State;;Unseen_Evidence", "").rpartition(";;")[2]
    if state in STATES:
        counts[kind, state] += 1
        thing.ViewObject.ShapeColor = STATES[state]
for thing in [one for one in document.Objects if getattr(one, "IfcType", "") == "Covering"]:
    document.removeObject(thing.Name)  # ceilings; hidden ones would still show in the shape of their storey
document.recompute()
for (kind, state), number in sorted(counts.items()):
    print(f"{number} {kind}: {state}")
FreeCADGui.updateGui()
view = FreeCADGui.ActiveDocument.ActiveView
view.viewIsometric()
view.fitAll()
view.saveImage(os.environ["PNG"], 1000, 700, "White")
sys.stdout.flush()
os._exit(0)  # without the window's question to save
