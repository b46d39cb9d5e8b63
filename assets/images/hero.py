#!/usr/bin/env python3
"""Makes the scene of hero.png: hero.py FlightHelmet.gltf hero.gltf   (write it beside FlightHelmet.gltf, whose files it refers to)

FlightHelmet is one of Khronos' glTF-Sample-Assets (CC0).  It stands on a glossy floor among 600 small lamps of four colors."""
import base64, json, math, random, struct, sys

source, target = sys.argv[1:]
g = json.load(open(source))
random.seed(7)
data = bytearray()
buffer = len(g["buffers"])


def accessor(values, kind, component, fmt, target):
    while len(data) % 4:
        data.append(0)
    start = len(data)
    for value in values:
        data.extend(struct.pack(fmt, *value))
    g["bufferViews"].append({"buffer": buffer, "byteOffset": start, "byteLength": len(data) - start, "target": target})
    entry = {"bufferView": len(g["bufferViews"]) - 1, "componentType": component, "count": len(values), "type": kind}
    if kind == "VEC3":
        entry["min"], entry["max"] = [[f(v[i] for v in values) for i in range(3)] for f in (min, max)]
    g["accessors"].append(entry)
    return len(g["accessors"]) - 1


def mesh(positions, normals, triangles, material):
    primitive = {
        "attributes": {
            "POSITION": accessor(positions, "VEC3", 5126, "<3f", 34962),
            "NORMAL": accessor(normals, "VEC3", 5126, "<3f", 34962),
        },
        "indices": accessor([(i,) for t in triangles for i in t], "SCALAR", 5125, "<I", 34963),
        "material": material,
    }
    g["meshes"].append({"primitives": [primitive]})
    return len(g["meshes"]) - 1


def material(color, roughness, metallic=0.0, emission=None, strength=1.0):
    m = {"pbrMetallicRoughness": {"baseColorFactor": [*color, 1.0], "roughnessFactor": roughness, "metallicFactor": metallic}}
    if emission:
        m["emissiveFactor"] = emission
        m["extensions"] = {"KHR_materials_emissive_strength": {"emissiveStrength": strength}}
    g["materials"].append(m)
    return len(g["materials"]) - 1


def node(**fields):
    g["nodes"].append(fields)
    g["scenes"][0]["nodes"].append(len(g["nodes"]) - 1)


def quad(center, u, v, of):
    corners = [[c + a * x + b * y for c, x, y in zip(center, u, v)] for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
    length = math.sqrt(sum(x * x for x in n))
    node(mesh=mesh(corners, [[x / length for x in n]] * 4, [(0, 1, 2), (0, 2, 3)], of))


g.setdefault("extensionsUsed", []).append("KHR_materials_emissive_strength")
quad([0, 0, 0], [0, 0, 6], [6, 0, 0], material([0.08, 0.08, 0.09], 0.25))
quad([0, 2, -2.2], [6, 0, 0], [0, 4, 0], material([0.35, 0.33, 0.32], 0.8))

# An octahedron of 8 mm for a lamp; lamps of one color share a mesh.
corners = [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]
faces = [(0, 2, 4), (2, 1, 4), (1, 3, 4), (3, 0, 4), (2, 0, 5), (1, 2, 5), (3, 1, 5), (0, 3, 5)]
colors = [[1.0, 0.36, 0.06], [1.0, 0.62, 0.22], [0.05, 0.45, 1.0], [0.80, 0.06, 0.40]]
lamps = [
    mesh([[0.008 * x for x in c] for c in corners], corners, faces, material([0, 0, 0], 1.0, emission=c, strength=130.0))
    for c in colors
]
yaw, pitch = 0.42, -0.09
placed = 0
while placed < 600:
    angle, height, distance = random.uniform(0, 2 * math.pi), random.uniform(0.05, 1.5), random.uniform(0.5, 2.1)
    x, z = distance * math.sin(angle), distance * math.cos(angle)
    along, across = x * math.sin(yaw) + z * math.cos(yaw), x * math.cos(yaw) - z * math.sin(yaw)
    # Behind the wall, or before the camera.
    if z < -2.1 or (along > 0.0 and abs(across) < 0.6):
        continue
    # Warm to the left, cold to the right.
    warm = random.random() < 0.5 - 0.5 * math.tanh(2 * across)
    node(mesh=lamps[random.choice([0, 1]) if warm else random.choice([2, 3])], translation=[x, height, z])
    placed += 1

g.setdefault("cameras", []).append({"type": "perspective", "perspective": {"yfov": 0.375, "znear": 0.01, "aspectRatio": 1.0}})
q = lambda axis, a: [axis[0] * math.sin(a / 2), axis[1] * math.sin(a / 2), axis[2] * math.sin(a / 2), math.cos(a / 2)]
a, b = q((0, 1, 0), yaw), q((1, 0, 0), pitch)
rotation = [
    a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1],
    a[3] * b[1] - a[0] * b[2] + a[1] * b[3] + a[2] * b[0],
    a[3] * b[2] + a[0] * b[1] - a[1] * b[0] + a[2] * b[3],
    a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2],
]
node(camera=0, rotation=rotation, translation=[2.15 * math.sin(yaw), 0.35 - 2.15 * math.sin(pitch), 2.15 * math.cos(yaw)])
uri = "data:application/octet-stream;base64," + base64.b64encode(bytes(data)).decode()
g["buffers"].append({"uri": uri, "byteLength": len(data)})
json.dump(g, open(target, "w"))
