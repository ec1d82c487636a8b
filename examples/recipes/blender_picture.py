# SPDX-License-Identifier: MIT
"""Run by Blender: import `completed.glb`, colour what was inferred, save a picture and a .blend file.

`xvfb-run blender -b --python blender_picture.py -- completed.glb picture.png X,Y,Z X,Y,Z`: the two places are
those of the camera and of what it looks at, metres, in the coordinates of the scans.
"""

import sys

import bpy
import numpy
from mathutils import Vector

numpy.bool = bool  # the importer of Debian's Blender 3.4 asks numpy for this old name
model, picture, eye, target = sys.argv[-4:]
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.import_scene.gltf(filepath=model)
scene, blue = bpy.context.scene, bpy.data.materials.new("inferred")
blue.diffuse_color = (0.05, 0.2, 0.8, 1.0)
meshes = [thing for thing in bpy.data.objects if thing.type == "MESH"]
inferred = [thing for thing in meshes if thing.name.startswith("hypothesised")]
for thing in inferred:
    thing.data.materials.clear()
    thing.data.materials.append(blue)
areas = [sum(face.area for thing in some for face in thing.data.polygons) for some in (meshes, inferred)]
print(f"{len(inferred)} of {len(meshes)} objects inferred, {areas[1]:.2f} of {areas[0]:.2f} m2")

camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
camera.data.angle = 1.2
camera.location, target = (Vector(map(float, place.split(","))) for place in (eye, target))
camera.rotation_euler = (target - camera.location).to_track_quat("-Z", "Y").to_euler()
scene.collection.objects.link(camera)
scene.camera, scene.render.engine, scene.render.filepath = camera, "BLENDER_WORKBENCH", picture
scene.display.shading.light, scene.display.shading.color_type = "FLAT", "TEXTURE"
scene.display.shading.show_backface_culling = True
scene.render.resolution_x, scene.render.resolution_y = 960, 640
scene.world = bpy.data.worlds.new("world")
scene.world.color = (1, 1, 1)
bpy.ops.render.render(write_still=True)
bpy.ops.wm.save_as_mainfile(filepath=picture.replace(".png", ".blend"))
