# SPDX-License-Identifier: MIT
"""Dictionary: numbers, pieces and keywords of formats that parsers stumble over."""

from __future__ import annotations

NUMBERS = (
    *b"""0|-0|1|-1|2|3|7|255|256|65536|1000000|99999999|2147483647|2147483648|4294967295|4294967296
9223372036854775807|9223372036854775808|18446744073709551616|-2147483648|-9999999999|1e400|-1e400|1e308|1e-320
1e10|1e19|1e39|nan|NaN|inf|-inf|Infinity|0x10|1_0|1,5|1.5.5|--1|+|1e9999999999|1j|True""".replace(
        b"\n", b"|"
    ).split(b"|"),
    b"",
    b"9" * 400,
    b"0." + b"3" * 400,
    b"9" * 5000,
    "\u0663".encode(),
)
PIECES = (
    *(bytes([value]) for value in b"\n\r\t ,;#\"'\\/\0\xff-$%"),
    *(
        b"\r\n",
        b"\xef\xbb\xbf",
        b"\xff\xfe",
        "\u2028".encode(),
        b"..",
        b"../secret",
        b"/etc/hostname",
        b"C:\\x",
    ),
    *(b"~/x", b"file:///etc/hostname", b"http://127.0.0.1:9/x", b"<script>alert(1)</script>"),
    *(b"{" * 2000, b"[" * 100000, b"a" * 10000, b"(" * 5000),
)
_WORDS = {
    ".obj": (
        "v ~vt ~vn ~f ~f 1//1 2//2 3//3~f -1 -2 -3~f 1/1/1~usemtl ~mtllib ~o ~g ~s off~l 1 2~p 1~"
        "f 1 2 3 4 5 6~f 0 0 0~v 1 2 3 4~v nan 0 0"
    ),
    ".mtl": (
        "newmtl ~Kd ~map_Kd ~Ka 1 1 1~map_Kd -s 1 1 1 ~d 0~Tr 1~illum 9~map_Bump ~map_Ka ~Kd 1~Kd a b c~"
        "Kd nan 0 0~Ns 1e400"
    ),
    ".ply": (
        "element vertex ~element face ~element edge 5~property list uchar int vertex_indices~"
        "property float x~property double ~property list double float vertex_indices~"
        "property list uchar float texcoord~format ascii 1.0~format binary_little_endian 1.0~"
        "format binary_big_endian 1.0~comment ~end_header~obj_info ~comment TextureFile ~"
        "comment unseen {}|~uchar~char~int8~double~uint"
    ),
    ".stl": (
        "solid ~facet normal 0 0 1~outer loop~vertex 0 0 0~endloop~endfacet~endsolid~unseen origin_m 0 0 0"
    ),
    ".off": ("OFF~COFF~NOFF~STOFF~4OFF~nOFF~OFF BINARY~3 0 1 2~0~1 0~-3 0 1 2"),
    ".pcd": (
        "VERSION 0.7~FIELDS x y z~SIZE 4 4 4~SIZE 8~TYPE F F F~TYPE I~TYPE U~COUNT 1 1 1~COUNT 99~WIDTH ~"
        "HEIGHT ~VIEWPOINT 0 0 0 1 0 0 0~VIEWPOINT 0 0 0 0 0 0 0~POINTS ~DATA ascii~DATA binary~"
        "DATA binary_compressed~rgb~rgba~intensity~normal_x normal_y normal_z~_"
    ),
    ".e57": (
        'type="Structure"~type="Vector"~type="CompressedVector"~type="Integer"~type="Float"~'
        'type="ScaledInteger"~type="String"~type="Blob"~fileOffset="48"~recordCount="0"~minimum="0"~'
        'maximum="0"~precision="single"~scale="0"~allowHeterogeneousChildren="0"~<rowIndex/>~'
        "<!DOCTYPE x [<!ENTITY a 'b'>]>~&a;~<![CDATA[~]]>~<pose>~</pose>"
    ),
    ".toml": (
        "[effects]~[noise]~[[scenes]]~[[planners]]~[sources]~kind = ~true~inf~nan~1979-05-27~[]~{}~'''~"
        "a = {b = {c = 1}}~width = 0~width = 100000000"
    ),
    ".txt": ("# unseen {}~x y z~x,y,z nx ny nz~0 0 0 0 0 0 1~1 2 3 0 0 0 0~# "),
    ".json": ('null~true~[]~{}~NaN~Infinity~""~1e999'),
}
KEYWORDS = {suffix: tuple(text.encode().split(b"~")) for suffix, text in _WORDS.items()}
"""Words of a format by its suffix, as they stand on a line."""
