"""Makes `textured.glb`, `sky.glb`, `area_lights.glb` and `interior.glb` and renders their references with Mitsuba 3, which shares no code
with this project.

    pip install mitsuba numpy OpenEXR pillow
    python3 make.py NAME PASSES

writes NAME.glb, NAME.exr, NAME_se.exr (the standard error of every pixel) and the environment, if any, into the folder above, and
prints the entry for `references.json`.  A pass has 256 samples per pixel.  Conventions that differ between glTF and Mitsuba (texture
transforms, spot cones, environment rows) are evaluated here and given to Mitsuba as plain coordinates or fine pictures.
"""

import functools
import io
import json
import pathlib
import struct
import sys

import mitsuba
import numpy
import OpenEXR
from PIL import Image

mitsuba.set_variant("llvm_ad_rgb")
SIZE = 128
SAMPLES = 256
FOLDER = pathlib.Path(__file__).resolve().parent.parent
RANDOM = numpy.random.default_rng(1)


class Mesh:
    """Vertices with normals, tangents and texture coordinates.  The last two may be None where no texture needs them."""

    def __init__(self, positions, normals, tangents, uvs, indices):
        self.positions, self.normals, self.tangents, self.uvs = (
            None if a is None else numpy.asarray(a, dtype="<f4") for a in (positions, normals, tangents, uvs)
        )
        self.indices = numpy.asarray(indices, dtype="<u4")

    def moved(self, matrix):
        """This mesh, without tangents, after a 4 x 4 matrix that keeps the winding."""
        linear = numpy.asarray(matrix)[:3, :3]
        assert numpy.linalg.det(linear) > 0
        normals = self.normals @ numpy.linalg.inv(linear)
        normals /= numpy.linalg.norm(normals, axis=1, keepdims=True)
        return Mesh(self.positions @ linear.T + matrix[:3, 3], normals, None, self.uvs, self.indices)


def joined(meshes):
    """One mesh, without tangents, of several."""
    first = numpy.cumsum([0] + [len(mesh.positions) for mesh in meshes])
    together = lambda name: numpy.concatenate([getattr(mesh, name) for mesh in meshes])
    indices = numpy.concatenate([mesh.indices + start for mesh, start in zip(meshes, first)])
    uvs = None if any(mesh.uvs is None for mesh in meshes) else together("uvs")
    return Mesh(together("positions"), together("normals"), None, uvs, indices)


def quad(origin, right, up):
    """A parallelogram; texture coordinates run along `right` and `up`, and so do the axes of normal maps."""
    origin, right, up = (numpy.array(v, dtype=float) for v in (origin, right, up))
    normal = numpy.cross(right, up)
    normal /= numpy.linalg.norm(normal)
    tangent = [*(right / numpy.linalg.norm(right)), 1.0]
    corners = [(0, 0), (1, 0), (1, 1), (0, 1)]
    positions = [origin + s * right + t * up for s, t in corners]
    return Mesh(positions, [normal] * 4, [tangent] * 4, corners, [[0, 1, 2], [0, 2, 3]])


def ball(center, radius, rows=24):
    """A smooth sphere of twice as many columns as rows of cells."""
    columns = 2 * rows
    phi, theta = numpy.meshgrid(numpy.linspace(0, 2 * numpy.pi, columns + 1), numpy.linspace(0, numpy.pi, rows + 1))
    phi, theta = phi.ravel(), theta.ravel()
    normals = numpy.stack([numpy.sin(theta) * numpy.sin(phi), numpy.cos(theta), numpy.sin(theta) * numpy.cos(phi)], 1)
    tangents = numpy.stack([numpy.cos(phi), 0 * phi, -numpy.sin(phi), 1 + 0 * phi], 1)
    first = (numpy.arange(rows)[:, None] * (columns + 1) + numpy.arange(columns)).ravel()
    indices = numpy.concatenate([
        numpy.stack([first, first + columns + 1, first + columns + 2], 1),
        numpy.stack([first, first + columns + 2, first + 1], 1),
    ])
    uvs = numpy.stack([phi, theta], 1)
    return Mesh(numpy.array(center) + radius * normals, normals, tangents, uvs, indices)


class Texture:
    """An 8-bit picture that repeats, with a texture transform as Bevy reads KHR_texture_transform."""

    def __init__(self, texels, srgb, nearest=False, scale=(1, 1), rotation=0.0, offset=(0, 0)):
        self.texels = numpy.asarray(texels, dtype=numpy.uint8)
        self.srgb, self.nearest = srgb, nearest
        self.scale, self.rotation, self.offset = scale, rotation, offset

    def transformed(self, uvs):
        u, v = uvs[:, 0] * self.scale[0], uvs[:, 1] * self.scale[1]
        c, s = numpy.cos(self.rotation), numpy.sin(self.rotation)
        return numpy.stack([c * u + s * v + self.offset[0], c * v - s * u + self.offset[1]], 1)

    def linear(self):
        values = self.texels.astype(numpy.float32) / 255
        if not self.srgb:
            return values
        color = values[..., :3]
        color = numpy.where(color <= 0.04045, color / 12.92, ((color + 0.055) / 1.055) ** 2.4)
        return numpy.concatenate([color, values[..., 3:]], 2).astype(numpy.float32)

    def for_mitsuba(self, channels, factor=1.0):
        return {
            "type": "bitmap",
            "bitmap": mitsuba.Bitmap(numpy.ascontiguousarray(factor * self.linear()[..., channels])),
            "raw": True,
            "filter_type": "nearest" if self.nearest else "bilinear",
            "wrap_mode": "repeat",
        }

    def for_gltf(self):
        file = io.BytesIO()
        Image.fromarray(self.texels).save(file, "png", optimize=True)
        return file.getvalue()


def colors(size):
    """Random colors of medium brightness, opaque."""
    texels = RANDOM.integers(60, 230, (size, size, 4))
    texels[..., 3] = 255
    return texels


def bumps(size, strength):
    """A normal map whose slopes repeat.  They are small: Mitsuba shows no light where a normal faces away, and we bend it."""
    at = 2 * numpy.pi * (numpy.arange(size) + 0.5) / size
    slope = numpy.stack(numpy.broadcast_arrays(
        strength * numpy.cos(at)[None, :] + 0.3 * strength, strength * numpy.sin(2 * at)[:, None]), 2)
    normals = numpy.concatenate([-slope, numpy.ones((size, size, 1))], 2)
    normals /= numpy.linalg.norm(normals, axis=2, keepdims=True)
    texels = numpy.rint((normals * 0.5 + 0.5) * 255)
    return numpy.concatenate([texels, numpy.full((size, size, 1), 255)], 2)


def holes(size):
    """Color and a mask of 0 or 255, with round holes."""
    at = (numpy.arange(size) + 0.5) / size * 4 % 1 - 0.5
    texels = numpy.empty((size, size, 4))
    texels[..., :3] = (90, 160, 70)
    texels[..., 3] = numpy.where(at[None, :] ** 2 + at[:, None] ** 2 < 0.11, 0, 255)
    return texels


class Material:
    """Lambert (specularFactor 0), or a perfect mirror.  `emission` is a texture, or a color, and the radiance of its white texels.  As in
    Bevy, the transform of the base color's texture is that of the others, too.  What has a mask is double-sided."""

    def __init__(self, color=(1, 1, 1), base=None, normal=None, mask=False, emission=None, mirror=False, double_sided=False):
        self.color, self.base, self.normal, self.mask = color, base, normal, mask
        self.emission, self.mirror, self.double_sided = emission, mirror, double_sided or mask


class Scene:
    def __init__(self, bounces, camera, note):
        self.bounces, self.camera, self.note = bounces, camera, note
        self.things = []
        self.spot = None
        self.environment = None
        # Emitters for Mitsuba alone: glTF has no area lights, so that the test adds them.
        self.area_lights = []

    def add(self, mesh, material, matrix=None):
        """Several things may share a mesh or a material."""
        self.things.append((mesh, material, matrix))


def textured():
    """Colors with transforms, a normal map, a mask, an emissive picture, and a spot light."""
    scene = Scene(6, ((0.4, 1.5, 4.6), (0, 0.9, 0), 40), "textures with transforms, a normal map, a mask, an emissive picture, a spot light")
    floor = Texture(colors(8), True, scale=(2.5, 1.5), rotation=0.5, offset=(0.13, 0.2))
    scene.add(quad((-2, 0, 2), (4, 0, 0), (0, 0, -4)), Material(base=floor))
    placed = {"scale": (3, 2), "offset": (0.3, 0.1)}
    wall = Material(base=Texture(colors(4), True, **placed), normal=Texture(bumps(16, 0.08), False, **placed))
    scene.add(quad((-2, 0, -1.5), (4, 0, 0), (0, 3, 0)), wall)
    scene.add(quad((-2, 0, 2), (0, 0, -4), (0, 3, 0)), Material(base=Texture(colors(4), True, nearest=True)))
    leaf = Texture(holes(64), True, nearest=True)
    scene.add(quad((-0.2, 0.5, 0.3), (1.1, 0, 0.4), (0, 1.1, -0.5)), Material(base=leaf, mask=True))
    lamp = (Texture(colors(4), True), 12.0)
    scene.add(quad((-1.4, 2.6, -0.9), (0.9, 0, 0), (0, 0, 0.9)), Material((0, 0, 0), emission=lamp))
    # Intensity in candela, position, target, inner and outer angle.
    scene.spot = (30.0, (1.3, 2.4, 2.2), (0.1, 0.6, -0.4), 0.2, 0.42)
    return scene


def sky():
    """An environment of 64 x 32 texels with a small bright area, on diffuse surfaces and a mirror."""
    scene = Scene(4, ((0, 1.6, 5), (0, 0.6, 0), 38), "an environment image of 64 x 32 texels with a small bright area")
    scene.add(quad((-3, 0, 3), (6, 0, 0), (0, 0, -6)), Material((0.5, 0.5, 0.5)))
    scene.add(ball((-0.75, 0.6, 0.2), 0.6), Material((0.7, 0.35, 0.2)))
    scene.add(ball((0.75, 0.6, -0.3), 0.6), Material((0.9, 0.9, 0.9), mirror=True))
    rows, columns = (numpy.arange(32)[:, None] + 0.5) / 32, (numpy.arange(64)[None, :] + 0.5) / 64
    up = numpy.cos(numpy.pi * rows) + 0 * columns
    image = numpy.stack([
        0.3 + 0.2 * up + 0.2 * numpy.cos(2 * numpy.pi * columns),
        0.4 + 0.3 * up + 0.1 * numpy.sin(4 * numpy.pi * columns),
        0.5 + 0.5 * up,
    ], 2)
    image[8:10, 40:43] = (160, 150, 120)
    scene.environment = image.astype(numpy.float32)
    return scene


def area_lights():
    """A sphere, a rectangle and a sun with a disk above diffuse surfaces and a mirror.

    Lights stop rays in Mitsuba and not here, so that each is rendered alone, before a black sky."""
    scene = Scene(4, ((0, 1.6, 5), (0, 0.6, 0), 38), "a sphere, a rectangle and a sun with a disk")
    scene.add(quad((-3, 0, 3), (6, 0, 0), (0, 0, -6)), Material((0.5, 0.5, 0.5)))
    scene.add(ball((-0.75, 0.6, 0.2), 0.6), Material((0.7, 0.35, 0.2)))
    scene.add(ball((0.75, 0.6, -0.3), 0.6), Material((0.9, 0.9, 0.9), mirror=True))
    scene.add(quad((-0.3, 0, -1.2), (1.0, 0, -0.4), (0, 1.5, 0)), Material((0.3, 0.5, 0.7)))
    sphere = {"type": "sphere", "center": (-1.0, 2.8, 1.5), "radius": 0.4}
    transform = mitsuba.ScalarTransform4f
    # Mitsuba's rectangle reaches from -1 to 1 and shines along +Z.
    turned = transform().look_at(origin=(1.6, 2.5, 1.0), target=(0.2, 0.3, -0.2), up=(0, 1, 0))
    rectangle = {"type": "rectangle", "to_world": turned @ transform().scale((0.6, 0.25, 1))}
    # The sun comes from (1, 2, 1) and has a diameter of 0.2 radians.
    far = transform().look_at(origin=(1000, 2000, 1000), target=(0, 0, 0), up=(0, 1, 0))
    sun = {"type": "disk", "to_world": far @ transform().scale(float(numpy.sqrt(6) * 1000 * numpy.tan(0.1)))}
    sun_radiance = 0.8 / (numpy.pi * numpy.sin(0.1) ** 2)
    for shape, radiance in ((sphere, (6, 3, 2)), (rectangle, (2, 4, 5)), (sun, [sun_radiance] * 3)):
        emitter = {"type": "area", "radiance": {"type": "rgb", "value": [float(channel) for channel in radiance]}}
        scene.area_lights.append(shape | {"emitter": emitter, "bsdf": {"type": "diffuse", "reflectance": 0.0}})
    return scene


def write_gltf(scene, path):
    """One node for each thing; those that share a mesh or a material share it in the file, too.  Pictures are in the file."""
    binary, views, accessors, images, samplers, textures, materials, meshes, nodes = (bytearray(), [], [], [], [], [], [], [], [])

    def view(data):
        while len(binary) % 4:
            binary.append(0)
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(data)})
        binary.extend(data)
        return len(views) - 1

    def accessor(array, kind):
        array = array.ravel() if kind == "SCALAR" else array
        entry = {"bufferView": view(array.tobytes()), "count": len(array), "type": kind}
        entry["componentType"] = 5125 if array.dtype == "<u4" else 5126
        if kind == "VEC3":
            entry |= {"min": array.min(0).tolist(), "max": array.max(0).tolist()}
        accessors.append(entry)
        return len(accessors) - 1

    def texture(picture):
        images.append({"bufferView": view(picture.for_gltf()), "mimeType": "image/png"})
        kind = 9728 if picture.nearest else 9729
        samplers.append({"magFilter": kind, "minFilter": kind, "wrapS": 10497, "wrapT": 10497})
        textures.append({"source": len(images) - 1, "sampler": len(samplers) - 1})
        transform = {"offset": picture.offset, "rotation": picture.rotation, "scale": picture.scale}
        return {"index": len(textures) - 1, "extensions": {"KHR_texture_transform": transform}}

    @functools.cache
    def material_of(material):
        metallic, roughness = (1, 0) if material.mirror else (0, 1)
        pbr = {"baseColorFactor": [*material.color, 1], "metallicFactor": metallic, "roughnessFactor": roughness}
        entry = {"pbrMetallicRoughness": pbr, "extensions": {"KHR_materials_specular": {"specularFactor": 0.0}}}
        if material.base:
            pbr["baseColorTexture"] = texture(material.base)
        if material.normal:
            entry["normalTexture"] = texture(material.normal)
        if material.mask:
            entry |= {"alphaMode": "MASK", "alphaCutoff": 0.5}
        if material.double_sided:
            entry["doubleSided"] = True
        if material.emission:
            radiance, strength = material.emission
            textured = isinstance(radiance, Texture)
            entry |= {"emissiveTexture": texture(radiance), "emissiveFactor": [1, 1, 1]} if textured else {"emissiveFactor": radiance}
            entry["extensions"]["KHR_materials_emissive_strength"] = {"emissiveStrength": strength}
        materials.append(entry)
        return len(materials) - 1

    @functools.cache
    def geometry_of(mesh):
        attributes = {"POSITION": accessor(mesh.positions, "VEC3"), "NORMAL": accessor(mesh.normals, "VEC3")}
        if mesh.tangents is not None:
            attributes["TANGENT"] = accessor(mesh.tangents, "VEC4")
        if mesh.uvs is not None:
            attributes["TEXCOORD_0"] = accessor(mesh.uvs, "VEC2")
        return {"attributes": attributes, "indices": accessor(mesh.indices, "SCALAR")}

    @functools.cache
    def mesh_of(mesh, material):
        index = material_of(material)
        meshes.append({"primitives": [geometry_of(mesh) | {"material": index}]})
        return len(meshes) - 1

    for mesh, material, matrix in scene.things:
        place = {} if matrix is None else {"matrix": numpy.asarray(matrix).T.ravel().tolist()}
        nodes.append({"mesh": mesh_of(mesh, material)} | place)

    origin, target, degrees = scene.camera
    nodes.append({"camera": 0, "matrix": looking(origin, target)})
    file = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "cameras": [{"type": "perspective", "perspective": {"yfov": numpy.radians(degrees), "znear": 0.01, "aspectRatio": 1.0}}],
        "extensionsUsed": ["KHR_materials_specular", "KHR_materials_emissive_strength", "KHR_texture_transform", "KHR_lights_punctual"],
    }
    if scene.spot:
        intensity, origin, target, inner, outer = scene.spot
        light = {"type": "spot", "color": [1, 1, 1], "intensity": intensity, "spot": {"innerConeAngle": inner, "outerConeAngle": outer}}
        file["extensions"] = {"KHR_lights_punctual": {"lights": [light]}}
        nodes.append({"matrix": looking(origin, target), "extensions": {"KHR_lights_punctual": {"light": 0}}})
    file |= {
        "scenes": [{"nodes": list(range(len(nodes)))}],
        "nodes": nodes, "meshes": meshes, "materials": materials, "accessors": accessors, "bufferViews": views,
    }
    file |= {name: part for name, part in (("textures", textures), ("images", images), ("samplers", samplers)) if part}
    while len(binary) % 4:
        binary.append(0)
    file["buffers"] = [{"byteLength": len(binary)}]
    text = json.dumps(file, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    path.write_bytes(
        struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(binary))
        + struct.pack("<I4s", len(text), b"JSON") + text
        + struct.pack("<I4s", len(binary), b"BIN\0") + binary
    )


def looking(origin, target):
    """The matrix, column by column, of something at `origin` whose -Z axis points to `target`."""
    back = numpy.subtract(origin, target).astype(float)
    back /= numpy.linalg.norm(back)
    right = numpy.cross((0, 1, 0), back)
    right /= numpy.linalg.norm(right)
    axes = [*right, 0, *numpy.cross(back, right), 0, *back, 0, *origin, 1]
    return [float(number) for number in axes]


def for_mitsuba(scene, area_light):
    origin, target, degrees = scene.camera
    transform = mitsuba.ScalarTransform4f
    parts = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": scene.bounces + 1, "rr_depth": 100},
        "camera": {
            "type": "perspective",
            "fov": degrees,
            "to_world": transform().look_at(origin=origin, target=target, up=(0, 1, 0)),
            "film": {"type": "hdrfilm", "width": SIZE, "height": SIZE, "rfilter": {"type": "box"}, "pixel_format": "rgb"},
            "sampler": {"type": "independent"},
        },
    }
    # One mesh for each material.
    groups = {}
    for mesh, material, matrix in scene.things:
        groups.setdefault(material, []).append(mesh if matrix is None else mesh.moved(matrix))
    for i, (material, meshes) in enumerate(groups.items()):
        parts[f"thing{i}"] = mesh_for_mitsuba(meshes[0] if len(meshes) == 1 else joined(meshes), material)
    if scene.spot:
        parts["spot"] = spot_for_mitsuba(*scene.spot)
    if scene.environment is not None:
        parts["sky"] = environment_for_mitsuba(scene.environment)
    if area_light:
        parts["area light"] = area_light
    return mitsuba.load_dict(parts)


def cut_out(mesh, mask):
    """A quad without the texels whose alpha is 0: shadow rays of Mitsuba are stopped by transparent surfaces too."""
    size = len(mask)
    s, t = (a.ravel() for a in numpy.meshgrid(numpy.arange(size + 1) / size, numpy.arange(size + 1) / size))
    origin, right, up = mesh.positions[0], mesh.positions[1] - mesh.positions[0], mesh.positions[3] - mesh.positions[0]
    rows, columns = numpy.nonzero(mask)
    first = rows * (size + 1) + columns
    indices = numpy.concatenate([
        numpy.stack([first, first + 1, first + size + 2], 1),
        numpy.stack([first, first + size + 2, first + size + 1], 1),
    ])
    every = lambda rows: numpy.repeat(rows[:1], len(s), 0)
    positions = origin + s[:, None] * right + t[:, None] * up
    return Mesh(positions, every(mesh.normals), every(mesh.tangents), numpy.stack([s, t], 1), indices)


def mesh_for_mitsuba(mesh, material):
    properties = mitsuba.Properties()
    if material.mask:
        mesh = cut_out(mesh, material.base.texels[..., 3])
    if material.mirror:
        bsdf = {"type": "conductor", "material": "none", "specular_reflectance": {"type": "rgb", "value": material.color}}
    else:
        color = {"type": "rgb", "value": material.color}
        bsdf = {"type": "diffuse", "reflectance": material.base.for_mitsuba([0, 1, 2]) if material.base else color}
    if material.normal:
        bsdf = {"type": "normalmap", "normalmap": material.normal.for_mitsuba([0, 1, 2]), "bsdf": bsdf}
    if material.double_sided:
        bsdf = {"type": "twosided", "bsdf": bsdf}
    properties["bsdf"] = mitsuba.load_dict(bsdf)
    if material.emission:
        radiance, strength = material.emission
        if isinstance(radiance, Texture):
            radiance = radiance.for_mitsuba([0, 1, 2], strength)
        else:
            radiance = {"type": "rgb", "value": [strength * channel for channel in radiance]}
        properties["emitter"] = mitsuba.load_dict({"type": "area", "radiance": radiance})
    textured = mesh.uvs is not None
    counts = len(mesh.positions), len(mesh.indices)
    result = mitsuba.Mesh("mesh", *counts, properties, has_vertex_normals=True, has_vertex_texcoords=textured)
    parameters = mitsuba.traverse(result)
    parameters["vertex_positions"] = mesh.positions.ravel()
    parameters["vertex_normals"] = mesh.normals.ravel()
    if textured:
        uvs = material.base.transformed(mesh.uvs) if material.base else mesh.uvs
        parameters["vertex_texcoords"] = uvs.astype(numpy.float32).ravel()
    parameters["faces"] = mesh.indices.ravel()
    parameters.update()
    return result


def spot_for_mitsuba(intensity, origin, target, inner, outer):
    """Bevy's cone, square of a ramp in the cosine, as a picture that Mitsuba projects within a hard cone."""
    size = 2048
    at = ((numpy.arange(size) + 0.5) / size * 2 - 1) * numpy.tan(outer)
    cosine = 1 / numpy.sqrt(1 + at[None, :] ** 2 + at[:, None] ** 2)
    ramp = numpy.clip((cosine - numpy.cos(outer)) / (numpy.cos(inner) - numpy.cos(outer)), 0, 1) ** 2
    return {
        "type": "spot",
        "to_world": mitsuba.ScalarTransform4f().look_at(origin=origin, target=target, up=(0, 1, 0)),
        "intensity": {"type": "rgb", "value": intensity},
        "cutoff_angle": float(numpy.degrees(outer)),
        "beam_width": float(numpy.degrees(outer)) * 0.99999,
        "texture": {
            "type": "bitmap", "raw": True, "wrap_mode": "clamp",
            "bitmap": mitsuba.Bitmap(numpy.repeat(ramp[..., None], 3, 2).astype(numpy.float32)),
        },
    }


def environment_for_mitsuba(image):
    """Our bilinear map on a fine grid: Mitsuba's rows run from pole to pole, and its columns begin half a turn away."""
    height, width = 1025, 2048
    v = numpy.arange(height) / (height - 1)
    u = ((numpy.arange(width) + 0.5) / width + 0.5) % 1
    x, y = u * image.shape[1] - 0.5, numpy.clip(v * image.shape[0] - 0.5, 0, image.shape[0] - 1)
    x0, y0 = numpy.floor(x).astype(int), numpy.minimum(numpy.floor(y).astype(int), image.shape[0] - 2)
    fx, fy = (x - x0)[None, :, None], (y - y0)[:, None, None]
    texel = lambda row, column: image[row[:, None], (column % image.shape[1])[None, :]]
    fine = (texel(y0, x0) * (1 - fx) + texel(y0, x0 + 1) * fx) * (1 - fy) + (texel(y0 + 1, x0) * (1 - fx) + texel(y0 + 1, x0 + 1) * fx) * fy
    return {"type": "envmap", "bitmap": mitsuba.Bitmap(fine.astype(numpy.float32))}


def write_exr(path, pixels):
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {"RGB": numpy.ascontiguousarray(pixels, dtype=numpy.float32)}) as file:
        file.write(str(path))


def render(scene, passes):
    """The mean of the passes, and its standard error: sums over the area lights."""
    mean, variance = 0, 0
    for light in scene.area_lights or [None]:
        loaded = for_mitsuba(scene, light)
        pictures = numpy.stack([numpy.array(mitsuba.render(loaded, spp=SAMPLES, seed=seed)) for seed in range(passes)])
        mean += pictures.mean(0)
        variance += pictures.var(0, ddof=1) / passes
    return mean, numpy.sqrt(variance)


def main():
    import interior

    name, passes = sys.argv[1], int(sys.argv[2])
    scene = {"textured": textured, "sky": sky, "area_lights": area_lights, "interior": interior.interior}[name]()
    write_gltf(scene, FOLDER / f"{name}.glb")
    if scene.environment is not None:
        write_exr(FOLDER / f"{name}_environment.exr", scene.environment)
    mean, error = render(scene, passes)
    write_exr(FOLDER / f"{name}.exr", mean)
    write_exr(FOLDER / f"{name}_se.exr", error)
    tiles = lambda pixels: pixels.mean(2).reshape(SIZE // 8, 8, SIZE // 8, 8).swapaxes(1, 2).reshape(-1, 64)
    lit = tiles(mean).sum(1) > 0
    tile_error = numpy.sqrt((tiles(error)[lit] ** 2).sum(1)) / tiles(mean)[lit].sum(1)
    print(json.dumps({name: {
        "size": [SIZE, SIZE],
        "spp": passes * SAMPLES,
        "mean": mean.mean((0, 1)).tolist(),
        "max_depth": scene.bounces + 1,
        "bounces": scene.bounces,
        "env": f"{name}_environment.exr" if scene.environment is not None else None,
        "note": scene.note,
        "image_rel_se": float(numpy.sqrt((error.mean(2) ** 2).sum()) / mean.mean(2).sum()),
        "tile8_rel_se_p95": float(numpy.percentile(tile_error, 95)),
    }}, indent=1))


if __name__ == "__main__":
    # `interior` imports this module, so that the program runs the imported copy: each class exists once.
    import make

    make.main()
