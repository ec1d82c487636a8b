# SPDX-License-Identifier: MIT
"""Run with QGIS's Python: open the plan of `completed.dxf`, list its layers with lengths, save a picture.

`QT_QPA_PLATFORM=offscreen python3 qgis_plan.py completed.dxf plan.png` (python3-qgis).
"""

import sys

from qgis.core import (
    QgsApplication,
    QgsCategorizedSymbolRenderer,
    QgsCoordinateReferenceSystem,
    QgsLineSymbol,
    QgsMapRendererParallelJob,
    QgsMapSettings,
    QgsRendererCategory,
    QgsVectorLayer,
)
from qgis.PyQt.QtCore import QSize

drawing, picture = sys.argv[1:]
application = QgsApplication([], False)
application.initQgis()
layer = QgsVectorLayer(f"{drawing}|layername=entities|geometrytype=LineString25D", "plan", "ogr")
layer.setSubsetString("Layer LIKE 'PLAN-%'")
layer.setCrs(QgsCoordinateReferenceSystem())  # the scan's own metres; a map's system only if scans had one
styles = {
    "MEASURED": ("black", "solid", 0.8),
    "INFERRED": ("blue", "dash", 0.6),
    "REST": ("brown", "solid", 0.3),
}
categories = []
for name, (colour, line, width) in styles.items():
    lengths = [one.geometry().length() for one in layer.getFeatures() if one["Layer"] == f"PLAN-{name}"]
    print(f"PLAN-{name}: {len(lengths)} lines, {sum(lengths):.2f} m")
    symbol = QgsLineSymbol.createSimple({"color": colour, "line_style": line, "width": str(width)})
    categories.append(QgsRendererCategory(f"PLAN-{name}", symbol, name.lower()))
layer.setRenderer(QgsCategorizedSymbolRenderer("Layer", categories))
settings = QgsMapSettings()
settings.setLayers([layer])
settings.setExtent(layer.extent().buffered(0.3))
settings.setOutputSize(QSize(900, 500))
job = QgsMapRendererParallelJob(settings)
job.start()
job.waitForFinished()
job.renderedImage().save(picture)
