"""Writes .glb files with trimesh into a folder, and prints their names."""

import sys
from pathlib import Path

import numpy
import trimesh
from PIL import Image
from trimesh.visual import ColorVisuals, TextureVisuals
from trimesh.visual.material import PBRMaterial

folder = Path(sys.argv[1])


def picture(size, value):
    """An image of `value(u, v)`, bytes of three channels."""
    v, u = numpy.mgrid[0:size, 0:size] / size
    return Image.fromarray(numpy.stack(value(u, v), axis=-1).clip(0, 255).astype(numpy.uint8))


def wave(f):
    return 127.5 + 127.5 * f


def globe(**values):
    """A sphere with texture coordinates."""
    rows, columns = 32, 64
    v, u = numpy.mgrid[0 : rows + 1, 0 : columns + 1]
    u, v = u.ravel() / columns, v.ravel() / rows
    ring = numpy.sin(v * numpy.pi)
    places = numpy.stack([ring * numpy.cos(u * 2 * numpy.pi), numpy.cos(v * numpy.pi), -ring * numpy.sin(u * 2 * numpy.pi)], -1)
    a = (numpy.arange(rows)[:, None] * (columns + 1) + numpy.arange(columns)).ravel()
    b, c, d = a + columns + 1, a + columns + 2, a + 1
    faces = numpy.concatenate([numpy.stack([a, b, c], -1), numpy.stack([a, c, d], -1)])
    visual = TextureVisuals(uv=numpy.stack([u, 1 - v], -1), material=PBRMaterial(**values))
    return trimesh.Trimesh(places, faces, vertex_normals=places, visual=visual, process=False)


def textured():
    colors = picture(256, lambda u, v: [wave(numpy.sin(u * 50)), wave(numpy.sin(v * 30)), 120 + 0 * u])
    shine = picture(128, lambda u, v: [255 + 0 * u, wave(numpy.sin(v * 40)), wave(numpy.sign(numpy.sin(u * 40)))])
    yield globe(baseColorTexture=colors, metallicRoughnessTexture=shine, metallicFactor=1.0, roughnessFactor=0.8)
    relief = picture(256, lambda u, v: [127.5 + 60 * numpy.cos(u * 80), 127.5 + 60 * numpy.cos(v * 60), 235 + 0 * u])
    bumpy = globe(baseColorFactor=[180, 200, 160, 255], normalTexture=relief, metallicFactor=0.0, roughnessFactor=0.5)
    bumpy.apply_translation([2.4, 0, 0])
    yield bumpy


def written(name, meshes):
    scene = trimesh.Scene()
    for mesh in meshes:
        scene.add_geometry(mesh)
    (folder / f"{name}.glb").write_bytes(scene.export(file_type="glb", include_normals=True))
    print(name)


def solids():
    for i, shape in enumerate([trimesh.creation.box(), trimesh.creation.capsule(radius=0.4), trimesh.creation.annulus(0.2, 0.6, 0.5)]):
        shape.apply_translation([i * 1.5, 0, 0])
        tint = numpy.array([200, 80 + 60 * i, 60])
        shade = 0.6 + 0.4 * (shape.vertices[:, 1:2] + 1)
        colors = numpy.concatenate([(tint * shade).clip(0, 255), 255 + 0 * shade], -1)
        shape.visual = ColorVisuals(shape, vertex_colors=colors.astype(numpy.uint8))
        yield shape


written("trimesh-textured", textured())
written("trimesh-solids", solids())
glowing = picture(128, lambda u, v: [wave(numpy.sin(u * 60)) * 0.8, 40 + 0 * u, 20 + 0 * u])
shaded = picture(128, lambda u, v: [wave(numpy.sin(v * 20)), 255 + 0 * u, 255 + 0 * u])
written("trimesh-glow", [globe(baseColorFactor=[90, 90, 110, 255], emissiveTexture=glowing, emissiveFactor=[1, 1, 1], occlusionTexture=shaded, metallicFactor=0.2, roughnessFactor=0.6)])
