//! Converts a Bevy mesh to triangles with valid positions and packed attributes.
//!
//! Any set of attributes, index width and triangle topology is accepted.  Unusable triangles are left out and counted by reason.  Of skinned
//! and morphed meshes this is the rest pose.

use super::rig::RigVertices;
use crate::gpu_layout::GpuTriangleAttributes;
use bevy::mesh::{Indices, Mesh, MeshVertexAttribute, PrimitiveTopology, VertexAttributeValues};
use half::f16;

type V3 = [f32; 3];

/// A linear color with alpha, as the bits of half floats.
pub type HalfColor = [u16; 4];

const WHITE: HalfColor = [f16::ONE.to_bits(); 4];

/// Largest accepted coordinate, in meters: products of three coordinates must not overflow an f32.
pub const MAX_COORDINATE: f32 = 1.0e12;

/// Smallest accepted square of twice the area, in m⁴: below it, the edge functions of the intersection test would be subnormal.
const MIN_SQUARED_DOUBLE_AREA: f64 = 1.0e-36;

/// The triangles of a mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Geometry {
    /// Corners of each triangle in object space.
    pub positions: Vec<[V3; 3]>,
    /// Attributes of the corners, in the same order.
    pub attributes: Vec<GpuTriangleAttributes>,
    /// Second texture coordinates of the corners, in the same order; empty if the mesh has none.
    pub second_uvs: Vec<[[f32; 2]; 3]>,
    /// Vertex colors of the corners, in the same order; empty if the mesh has none, or if all of them are white.
    pub colors: Vec<[HalfColor; 3]>,
    /// The vertex of each corner, in the same order; empty if the mesh does not bend.
    pub corners: Vec<[u32; 3]>,
    /// Joints and morph targets of the vertices.
    pub rig: Option<RigVertices>,
    /// Numbers of triangles that are left out.
    pub dropped: Dropped,
    /// The mesh has normals.  Otherwise each triangle has its flat normal.
    pub has_normals: bool,
    /// The mesh has texture coordinates.  Otherwise they are 0.
    pub has_uvs: bool,
    /// The mesh has tangents.  Otherwise each triangle gets one from its texture coordinates.
    pub has_tangents: bool,
}

/// Numbers of triangles that are left out of a [`Geometry`], by reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Dropped {
    /// An index is beyond the last vertex.
    pub out_of_range: usize,
    /// A coordinate is NaN, infinite or beyond [`MAX_COORDINATE`].
    pub non_finite: usize,
    /// The triangle has no area.
    pub degenerate: usize,
}

impl Dropped {
    /// The sum over all reasons.
    pub fn total(&self) -> usize {
        self.out_of_range + self.non_finite + self.degenerate
    }
}

/// Reasons why a mesh cannot be converted.  Each message continues a sentence that starts with the name of the mesh.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum GeometryError {
    /// Bevy has already moved the vertices to the render world.
    Extracted,
    /// The mesh has no position attribute.
    NoPositions,
    /// The positions have an unsupported format: not three or four floats or normalized integers.
    PositionFormat(&'static str),
    /// The mesh consists of lines or points.
    Topology(&'static str),
}

impl std::fmt::Display for GeometryError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Extracted => {
                write!(f, "has no vertices in the main world, because they were moved to the render world")
            }
            Self::NoPositions => write!(f, "has no positions"),
            Self::PositionFormat(format) => write!(f, "has positions of {format}, but Float32x3 is expected"),
            Self::Topology(topology) => write!(f, "has the topology {topology}, but only triangles are supported"),
        }
    }
}

impl std::error::Error for GeometryError {}

/// Converts a mesh.  An empty mesh gives no triangles.  Never panics.
pub fn triangles_of(mesh: &Mesh) -> Result<Geometry, GeometryError> {
    let strip = match mesh.primitive_topology() {
        PrimitiveTopology::TriangleList => false,
        PrimitiveTopology::TriangleStrip => true,
        PrimitiveTopology::PointList => return Err(GeometryError::Topology("PointList")),
        PrimitiveTopology::LineList => return Err(GeometryError::Topology("LineList")),
        PrimitiveTopology::LineStrip => return Err(GeometryError::Topology("LineStrip")),
    };
    let positions = attribute(mesh, Mesh::ATTRIBUTE_POSITION)?.ok_or(GeometryError::NoPositions)?;
    if width(positions) < 3 {
        return Err(GeometryError::PositionFormat(format_name(positions)));
    }
    // An attribute with an unsupported format counts as missing.
    let readable = |kind, min_width| Ok(attribute(mesh, kind)?.filter(|values| width(values) >= min_width));
    let normals = readable(Mesh::ATTRIBUTE_NORMAL, 3)?;
    let uvs = readable(Mesh::ATTRIBUTE_UV_0, 2)?;
    let second_uvs = readable(Mesh::ATTRIBUTE_UV_1, 2)?;
    let colors = readable(Mesh::ATTRIBUTE_COLOR, 4)?;
    let tangents = readable(Mesh::ATTRIBUTE_TANGENT, 4)?;
    let indices = mesh.try_indices_option().map_err(|_| GeometryError::Extracted)?;

    let mut geometry = Geometry {
        has_normals: normals.is_some(),
        has_uvs: uvs.is_some(),
        has_tangents: tangents.is_some(),
        ..Default::default()
    };
    let vertices = positions.len();
    geometry.rig = RigVertices::of(mesh, vertices);
    for_each_triangle(strip, vertices, indices, |corners| {
        if corners.iter().any(|&c| c >= vertices) {
            geometry.dropped.out_of_range += 1;
            return;
        }
        let p = corners.map(|c| first_three(read(positions, c)));
        if !p.iter().flatten().all(|x| x.abs() <= MAX_COORDINATE) {
            geometry.dropped.non_finite += 1;
            return;
        }
        // A triangle that bends may have an area in another pose, such as that of a closed eyelid.
        let rest_normal = geometry.rig.as_ref().map(|_| [0.0, 0.0, 1.0]);
        let Some(flat) = flat_normal(&p).or(rest_normal) else {
            geometry.dropped.degenerate += 1;
            return;
        };
        if geometry.rig.is_some() {
            geometry.corners.push(corners.map(|corner| corner as u32));
        }
        if second_uvs.is_some() {
            geometry.second_uvs.push(corner_uvs(second_uvs, corners));
        }
        if let Some(colors) = colors {
            geometry.colors.push(corners.map(|c| half_color(read(colors, c))));
        }
        geometry.positions.push(p);
        geometry.attributes.push(attributes_of(corners, &p, flat, [normals, uvs, tangents]));
    });
    if geometry.colors.as_flattened().iter().all(|color| *color == WHITE) {
        geometry.colors.clear();
    }
    Ok(geometry)
}

// Normals, texture coordinates and tangents of the corners.  `flat`: normal of the triangle, where the mesh has none.
fn attributes_of(
    corners: [usize; 3],
    p: &[V3; 3],
    flat: V3,
    [normals, uvs, tangents]: [Option<&VertexAttributeValues>; 3],
) -> GpuTriangleAttributes {
    let n = corners.map(|c| normals.and_then(|v| unit(first_three(read(v, c)))).unwrap_or(flat));
    let uv = corner_uvs(uvs, corners);
    let generated = triangle_tangent(p, &uv);
    let t: [u32; 3] = std::array::from_fn(|i| {
        let given = tangents.map(|v| read(v, corners[i]));
        let given = given.and_then(|t| Some((unit(first_three(t))?, t[3] < 0.0)));
        let (tangent, flipped) = given
            .or_else(|| generated.map(|(tangent, bitangent)| (tangent, flips(n[i], tangent, bitangent))))
            .unwrap_or((n[i], false));
        pack_tangent(perpendicular(tangent, n[i]), flipped)
    });
    GpuTriangleAttributes {
        normals: n.map(octahedral_encode),
        tangent_a: t[0],
        tangent_b: t[1],
        tangent_c: t[2],
        uv_a: uv[0],
        uv_b: uv[1],
        uv_c: uv[2],
    }
}

fn corner_uvs(values: Option<&VertexAttributeValues>, corners: [usize; 3]) -> [[f32; 2]; 3] {
    corners.map(|c| {
        let [u, v, ..] = values.map_or([0.0; 4], |values| read(values, c));
        [finite_or_zero(u), finite_or_zero(v)]
    })
}

// Colors of unlit objects may exceed 1, for glow.
fn half_color([r, g, b, a]: [f32; 4]) -> HalfColor {
    let most = f16::MAX.to_f32();
    [(r, most), (g, most), (b, most), (a, 1.0)]
        .map(|(c, most)| f16::from_f32(finite_or_zero(c).clamp(0.0, most)).to_bits())
}

/// Octahedral encoding of a unit vector in two snorm16, equal to `octahedral_encode` in `shaders/common/math.wgsl`.
pub fn octahedral_encode(n: V3) -> u32 {
    let sum = n[0].abs() + n[1].abs() + n[2].abs();
    let (x, y) = (n[0] / sum, n[1] / sum);
    let sign = |v: f32| if v >= 0.0 { 1.0 } else { -1.0 };
    let (x, y) = if n[2] >= 0.0 { (x, y) } else { ((1.0 - y.abs()) * sign(x), (1.0 - x.abs()) * sign(y)) };
    let snorm = |v: f32| (v.clamp(-1.0, 1.0) * 32767.0).round() as i16 as u16 as u32;
    snorm(x) | snorm(y) << 16
}

/// Octahedral encoding of a tangent.  The lowest bit says whether the bitangent is flipped (w < 0 in Bevy's attribute).
pub fn pack_tangent(tangent: V3, flipped: bool) -> u32 {
    octahedral_encode(tangent) & !1 | u32::from(flipped)
}

fn attribute(mesh: &Mesh, kind: MeshVertexAttribute) -> Result<Option<&VertexAttributeValues>, GeometryError> {
    mesh.try_attribute_option(kind).map_err(|_| GeometryError::Extracted)
}

// Visits the vertex indices of each triangle, in order.  Triangles with equal indices, which join the parts of a strip, are skipped.
fn for_each_triangle(strip: bool, vertices: usize, indices: Option<&Indices>, mut visit: impl FnMut([usize; 3])) {
    const RESTART: usize = usize::MAX;
    let numbers: Box<dyn Iterator<Item = usize>> = match indices {
        None => Box::new(0..vertices),
        Some(Indices::U16(v)) => {
            Box::new(v.iter().map(move |&i| if strip && i == u16::MAX { RESTART } else { i.into() }))
        }
        Some(Indices::U32(v)) => {
            Box::new(v.iter().map(move |&i| if strip && i == u32::MAX { RESTART } else { i as usize }))
        }
    };
    let mut last = [0; 3];
    let mut seen = 0;
    for number in numbers {
        if strip && number == RESTART {
            seen = 0;
            continue;
        }
        last = [last[1], last[2], number];
        seen += 1;
        if strip && seen >= 3 {
            let [a, b, c] = last;
            if a != b && b != c && c != a {
                // Every second triangle of a strip has the opposite winding.
                visit(if seen % 2 == 1 { last } else { [b, a, c] });
            }
        } else if !strip && seen == 3 {
            visit(last);
            seen = 0;
        }
    }
}

// Number of components that `read` returns; 0 for an unsupported format.
fn width(values: &VertexAttributeValues) -> usize {
    use VertexAttributeValues as V;
    match values {
        V::Float32x2(_) | V::Float16x2(_) | V::Float64x2(_) | V::Unorm8x2(_) | V::Snorm8x2(_) => 2,
        V::Unorm16x2(_) | V::Snorm16x2(_) => 2,
        V::Float32x3(_) | V::Float64x3(_) => 3,
        V::Float32x4(_) | V::Float16x4(_) | V::Float64x4(_) | V::Unorm8x4(_) | V::Snorm8x4(_) => 4,
        V::Unorm16x4(_) | V::Snorm16x4(_) => 4,
        _ => 0,
    }
}

// The value of one vertex as floats; missing components are 0.  Beyond the last vertex it is NaN, which every caller replaces.
fn read(values: &VertexAttributeValues, i: usize) -> [f32; 4] {
    fn get<T: Copy, const N: usize>(v: &[[T; N]], i: usize, float: impl Fn(T) -> f32) -> [f32; 4] {
        let Some(x) = v.get(i) else { return [f32::NAN; 4] };
        std::array::from_fn(|k| x.get(k).map_or(0.0, |&c| float(c)))
    }
    use VertexAttributeValues as V;
    let unorm8 = |x: u8| f32::from(x) / 255.0;
    let snorm8 = |x: i8| (f32::from(x) / 127.0).max(-1.0);
    let unorm16 = |x: u16| f32::from(x) / 65535.0;
    let snorm16 = |x: i16| (f32::from(x) / 32767.0).max(-1.0);
    match values {
        V::Float32x2(v) => get(v, i, |x| x),
        V::Float32x3(v) => get(v, i, |x| x),
        V::Float32x4(v) => get(v, i, |x| x),
        V::Float16x2(v) => get(v, i, |x| x.to_f32()),
        V::Float16x4(v) => get(v, i, |x| x.to_f32()),
        V::Float64x2(v) => get(v, i, |x| x as f32),
        V::Float64x3(v) => get(v, i, |x| x as f32),
        V::Float64x4(v) => get(v, i, |x| x as f32),
        V::Unorm8x2(v) => get(v, i, unorm8),
        V::Unorm8x4(v) => get(v, i, unorm8),
        V::Snorm8x2(v) => get(v, i, snorm8),
        V::Snorm8x4(v) => get(v, i, snorm8),
        V::Unorm16x2(v) => get(v, i, unorm16),
        V::Unorm16x4(v) => get(v, i, unorm16),
        V::Snorm16x2(v) => get(v, i, snorm16),
        V::Snorm16x4(v) => get(v, i, snorm16),
        _ => [f32::NAN; 4],
    }
}

fn format_name(values: &VertexAttributeValues) -> &'static str {
    use VertexAttributeValues as V;
    match values {
        V::Float32(_) | V::Float16(_) | V::Float64(_) => "one float",
        V::Float32x2(_) | V::Float16x2(_) | V::Float64x2(_) => "two floats",
        V::Unorm8x2(_) | V::Snorm8x2(_) | V::Unorm16x2(_) | V::Snorm16x2(_) => "two normalized integers",
        _ => "integers",
    }
}

// Unit normal of the triangle; `None` if it has no area.  f64 avoids overflow and the cancellation in the differences.
fn flat_normal(p: &[V3; 3]) -> Option<V3> {
    let n = cross(subtract(p[1], p[0]), subtract(p[2], p[0]));
    let square = dot(n, n);
    (square > MIN_SQUARED_DOUBLE_AREA).then(|| n.map(|x| (x / square.sqrt()) as f32))
}

// Directions in which u and v grow; `None` if the texture coordinates span no area.
fn triangle_tangent(p: &[V3; 3], uv: &[[f32; 2]; 3]) -> Option<(V3, [f64; 3])> {
    let (e1, e2) = (subtract(p[1], p[0]), subtract(p[2], p[0]));
    let d = |i: usize| [f64::from(uv[i][0]) - f64::from(uv[0][0]), f64::from(uv[i][1]) - f64::from(uv[0][1])];
    let (d1, d2) = (d(1), d(2));
    let sign = (d1[0] * d2[1] - d2[0] * d1[1]).signum();
    if d1[0] * d2[1] == d2[0] * d1[1] {
        return None;
    }
    let tangent = std::array::from_fn(|k| sign * (e1[k] * d2[1] - e2[k] * d1[1]));
    let bitangent = std::array::from_fn(|k| sign * (e2[k] * d1[0] - e1[k] * d2[0]));
    Some((unit_f64(tangent)?, bitangent))
}

// Whether w is negative.  Bevy's bitangent is w cross(n, t) and points against the direction of v, because v points down in an image.
fn flips(n: V3, tangent: V3, bitangent: [f64; 3]) -> bool {
    dot(cross(n.map(f64::from), tangent.map(f64::from)), bitangent) > 0.0
}

// The normalized part of `t` perpendicular to `n`; any vector perpendicular to `n` if that part vanishes.
fn perpendicular(t: V3, n: V3) -> V3 {
    let (t, n) = (t.map(f64::from), n.map(f64::from));
    let along = dot(t, n);
    let across: [f64; 3] = std::array::from_fn(|k| t[k] - along * n[k]);
    if dot(across, across) > 1.0e-8
        && let Some(unit) = unit_f64(across)
    {
        return unit;
    }
    let other = if n[0].abs() < 0.6 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
    unit_f64(cross(cross(n, other), n)).unwrap_or([1.0, 0.0, 0.0])
}

fn unit(v: V3) -> Option<V3> {
    unit_f64(v.map(f64::from))
}

fn unit_f64(v: [f64; 3]) -> Option<V3> {
    let length = dot(v, v).sqrt();
    (length.is_finite() && length > 1.0e-30).then(|| v.map(|x| (x / length) as f32))
}

fn finite_or_zero(x: f32) -> f32 {
    if x.is_finite() { x } else { 0.0 }
}

fn first_three(v: [f32; 4]) -> V3 {
    [v[0], v[1], v[2]]
}

fn subtract(a: V3, b: V3) -> [f64; 3] {
    std::array::from_fn(|k| f64::from(a[k]) - f64::from(b[k]))
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}
