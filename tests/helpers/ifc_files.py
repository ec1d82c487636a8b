# SPDX-License-Identifier: MIT
"""Small IFC files as text: boxes on storeys, in any unit, with openings, types, mapped items and a map."""

from collections.abc import Sequence
from dataclasses import dataclass

UNITS = {
    "m": ("IFCSIUNIT(*,.LENGTHUNIT.,$,.METRE.)", 1.0),
    "mm": ("IFCSIUNIT(*,.LENGTHUNIT.,.MILLI.,.METRE.)", 0.001),
    "ft": ("IFCCONVERSIONBASEDUNIT(#7,.LENGTHUNIT.,'FOOT',#8)", 0.3048),
    "none": ("IFCSIUNIT(*,.PLANEANGLEUNIT.,$,.RADIAN.)", 1.0),
}


# What follows the shape, in IFC4 and IFC2X3
_MORE = {
    "IFCDOOR": ("$,$,$,$,$,$", "$,$,$"),
    "IFCWALL": ("$,$", "$"),
    "IFCCOLUMN": ("$,$", "$"),
    "IFCOPENINGELEMENT": ("$,$", "$"),
    "IFCVIRTUALELEMENT": ("$", "$"),
    "IFCANNOTATION": ("", ""),
    "IFCSPACE": ("$,.ELEMENT.,.INTERNAL.,$", "$,.ELEMENT.,.INTERNAL.,$"),
}
MAP = (
    "#40=IFCPROJECTEDCRS('EPSG:25832',$,$,$,$,$,#6)",
    "#41=IFCMAPCONVERSION(#20,#40,500000.125,5600000.25,100.5,0.5,0.8660254037844386,{scale})",
)


@dataclass(frozen=True)
class Box:
    """An element that is a box: class, least corner and size in metres, storey, how its body is given."""

    ifc_class: str = "IFCWALL"
    at: tuple[float, float, float] = (0.0, 0.0, 0.0)
    size: tuple[float, float, float] = (4.0, 0.2, 2.5)
    name: str = "wall"
    storey: int = 0
    opening: tuple[float, float, float, float] | None = None  # x, z, width, height, metres
    body: str = "extruded"  # or "mapped", "brep", "inside out", "open", "none", "broken"
    type_name: str = ""
    colour: tuple[float, float, float] | None = None
    global_id: str = ""


class IfcText:
    """An IFC file that grows; numbers of lines from 100."""

    def __init__(self, unit: str, schema: str) -> None:
        self.lines: list[str] = []
        self.schema, (self.unit, metres) = schema, UNITS[unit]
        self.scale = 1 / metres

    def add(self, line: str) -> str:
        self.lines.append(line)
        return f"#{99 + len(self.lines)}"

    def guid(self) -> str:
        return f"'0{len(self.lines):021d}'"

    def point(self, *place: float) -> str:
        return self.add(f"IFCCARTESIANPOINT(({','.join(f'{one * self.scale:.9f}' for one in place)}))")

    def placement(self, above: str, at: Sequence[float]) -> str:
        axes = self.add(f"IFCAXIS2PLACEMENT3D({self.point(*at)},$,$)")
        return self.add(f"IFCLOCALPLACEMENT({above},{axes})")

    def block(self, at: Sequence[float], size: Sequence[float]) -> str:
        """A box extruded upwards from its least corner."""
        middle = self.point(size[0] / 2, size[1] / 2)
        flat = self.add(f"IFCAXIS2PLACEMENT2D({middle},$)")
        sides = ",".join(f"{one * self.scale:.9f}" for one in size[:2])
        profile = self.add(f"IFCRECTANGLEPROFILEDEF(.AREA.,$,{flat},{sides})")
        axes = self.add(f"IFCAXIS2PLACEMENT3D({self.point(*at)},$,$)")
        return self.add(f"IFCEXTRUDEDAREASOLID({profile},{axes},#5,{size[2] * self.scale:.9f})")

    def shell(self, at: Sequence[float], size: Sequence[float], inward: bool, n_faces: int = 6) -> str:
        """A closed shell of a box, or of some of its faces."""
        corners = [
            self.point(*(a + k * s for a, k, s in zip(at, (x, y, z), size, strict=True)))
            for x in (0, 1) for y in (0, 1) for z in (0, 1)
        ]  # fmt: skip
        quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
        faces = []
        for quad in quads[:n_faces]:
            loop = self.add(f"IFCPOLYLOOP(({','.join(corners[k] for k in quad[:: -1 if inward else 1])}))")
            faces.append(self.add(f"IFCFACE(({self.add(f'IFCFACEOUTERBOUND({loop},.T.)')}))"))
        kind = "IFCCLOSEDSHELL" if n_faces == 6 else "IFCOPENSHELL"
        return self.add(f"{kind}(({','.join(faces)}))")

    def body(self, box: Box) -> tuple[str, str]:
        """Kind of representation and its item."""
        zero = (0.0, 0.0, 0.0)
        if box.body == "broken":
            return "SweptSolid", self.add("IFCEXTRUDEDAREASOLID($,$,#5,1.)")
        if box.body == "brep":
            return "Brep", self.add(f"IFCFACETEDBREP({self.shell(zero, box.size, False)})")
        if box.body == "inside out":
            return "Brep", self.add(f"IFCFACETEDBREP({self.shell(zero, box.size, True)})")
        if box.body == "open":
            shell = self.shell(zero, box.size, False, 5)
            return "SurfaceModel", self.add(f"IFCSHELLBASEDSURFACEMODEL(({shell}))")
        solid = self.block(zero, box.size)
        if box.body != "mapped":
            return "SweptSolid", solid
        shape = self.add(f"IFCSHAPEREPRESENTATION(#20,'Body','SweptSolid',({solid}))")
        source = self.add(f"IFCREPRESENTATIONMAP(#4,{shape})")
        target = self.add("IFCCARTESIANTRANSFORMATIONOPERATOR3D($,$,#3,1.,$)")
        return "MappedRepresentation", self.add(f"IFCMAPPEDITEM({source},{target})")

    def element(self, box: Box, storey: str) -> str:
        """An element in the frame `storey`, with its opening and its type."""
        placement, shape = self.placement(storey, box.at), "$"
        if box.body != "none":
            kind, item = self.body(box)
            self.paint(item, box.colour)
            held = self.add(f"IFCSHAPEREPRESENTATION(#20,'Body','{kind}',({item}))")
            shape = self.add(f"IFCPRODUCTDEFINITIONSHAPE($,$,({held}))")
        more = _MORE.get(box.ifc_class, ("$,$", "$,$"))[self.schema == "IFC2X3"]
        values = ",".join(["$", f"'{box.name}'", "$", "$", placement, shape, *([more] if more else [])])
        made = self.add(f"{box.ifc_class}({box.global_id or self.guid()},{values})")
        if box.opening:
            x, z, width, height = box.opening
            hole = Box("IFCOPENINGELEMENT", (x, -1.0, z), (width, 3.0, height), "hole")
            self.add(f"IFCRELVOIDSELEMENT({self.guid()},$,$,$,{made},{self.element(hole, placement)})")
        if box.type_name:
            kind = self.add(
                f"{box.ifc_class}TYPE({self.guid()},$,'{box.type_name}',$,$,$,$,$,$,.NOTDEFINED.)"
            )
            self.add(f"IFCRELDEFINESBYTYPE({self.guid()},$,$,$,({made}),{kind})")
        return made

    def paint(self, item: str, colour: tuple[float, float, float] | None) -> None:
        """A style for an item."""
        if colour is None:
            return
        old = self.schema == "IFC2X3"
        rgb = self.add(f"IFCCOLOURRGB($,{','.join(f'{one:.6f}' for one in colour)})")
        shade = self.add(f"IFCSURFACESTYLESHADING({rgb}{'' if old else ',0.'})")
        style = self.add(f"IFCSURFACESTYLE('s',.BOTH.,({shade}))")
        style = self.add(f"IFCPRESENTATIONSTYLEASSIGNMENT(({style}))") if old else style
        self.add(f"IFCSTYLEDITEM({item},({style}),$)")


def ifc_text(
    boxes: Sequence[Box],
    *,
    unit: str = "m",
    schema: str = "IFC4",
    storeys: Sequence[tuple[str, float]] = (("Ground", 0.0),),
    site: tuple[float, float, float] = (0.0, 0.0, 0.0),
    conversion: Sequence[str] = (),
) -> str:
    """The text of an IFC file; `conversion` holds lines from #40 on (`MAP`)."""
    file = IfcText(unit, schema)
    ground = file.placement("$", site)
    place = file.add(f"IFCSITE({file.guid()},$,'Site',$,$,{ground},$,$,.ELEMENT.,$,$,$,$,$)")
    file.add(f"IFCRELAGGREGATES({file.guid()},$,$,$,#30,({place}))")
    for k, (name, height) in enumerate(storeys):
        at = file.placement(ground, (0.0, 0.0, height))
        level = file.add(
            f"IFCBUILDINGSTOREY({file.guid()},$,'{name}',$,$,{at},$,$,.ELEMENT.,{height * file.scale:.6f})"
        )
        file.add(f"IFCRELAGGREGATES({file.guid()},$,$,$,{place},({level}))")
        inside = [file.element(box, at) for box in boxes if box.storey == k]
        if inside:
            file.add(f"IFCRELCONTAINEDINSPATIALSTRUCTURE({file.guid()},$,$,$,({','.join(inside)}),{level})")
    head = [
        "#3=IFCCARTESIANPOINT((0.,0.,0.))",
        "#4=IFCAXIS2PLACEMENT3D(#3,$,$)",
        "#5=IFCDIRECTION((0.,0.,1.))",
        "#6=IFCSIUNIT(*,.LENGTHUNIT.,$,.METRE.)",
        "#7=IFCDIMENSIONALEXPONENTS(1,0,0,0,0,0,0)",
        "#8=IFCMEASUREWITHUNIT(IFCLENGTHMEASURE(0.3048),#6)",
        f"#9={file.unit}",
        "#10=IFCUNITASSIGNMENT((#9))",
        "#20=IFCGEOMETRICREPRESENTATIONCONTEXT($,'Model',3,1.E-6,#4,$)",
        "#30=IFCPROJECT('0000000000000000000030',$,'P',$,$,$,$,(#20),#10)",
        *(line.format(scale=1 / file.scale) for line in conversion),
    ]
    lines = [*head, *(f"#{number}={line}" for number, line in enumerate(file.lines, start=100))]
    body = "".join(f"{line};\n" for line in lines)
    return (
        "ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION(('ViewDefinition [CoordinationView]'),'2;1');\n"
        "FILE_NAME('a.ifc','2026-01-01T00:00:00',(''),(''),'','','');\n"
        f"FILE_SCHEMA(('{schema}'));\nENDSEC;\nDATA;\n{body}ENDSEC;\nEND-ISO-10303-21;\n"
    )
