//! Converts a Bevy mesh to triangles over packed vertices with valid positions.
//!
//! Any set of attributes, index width and triangle topology is accepted.  Unusable triangles are left out and counted by reason.  Of skinned
//! and morphed meshes this is the rest pose.  Triangles share the vertices that they share in the mesh.  In a mesh without indices, vertices
//! with equal bits are one.

use super::rig::RigVertices;
use crate::gpu_layout::{GpuVertex, NONE, NOT_GIVEN};
use bevy::{
    mesh::{Indices, Mesh, MeshVertexAttribute, PrimitiveTopology, VertexAttributeValues},
    platform::collections::HashMap,
};
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
    /// The vertices that triangles have.
    pub vertices: Vec<GpuVertex>,
    /// The vertices of each triangle, as indices in `vertices`.
    pub triangles: Vec<[u32; 3]>,
    /// The mesh's vertex of each of `vertices`: the first one if several are equal.
    pub sources: Vec<u32>,
    /// Second texture coordinates of the corners of each triangle; empty if the mesh has none.
    pub second_uvs: Vec<[[f32; 2]; 3]>,
    /// Vertex colors of the corners of each triangle; empty if the mesh has none, or if all of them are white.
    pub colors: Vec<[HalfColor; 3]>,
    /// Joints and morph targets of the vertices.
    pub rig: Option<RigVertices>,
    /// Numbers of triangles that are left out.
    pub dropped: Dropped,
}

impl Geometry {
    /// Corners of each triangle in object space.
    pub fn corners(&self) -> Vec<[V3; 3]> {
        self.triangles.iter().map(|triangle| triangle.map(|vertex| self.vertices[vertex as usize].position)).collect()
    }
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
    /// The end of a sentence about the mesh, if it is broken.  Triangles without an area are common, as at the poles of a sphere.
    pub fn complaint(self) -> Option<String> {
        let reasons = [
            (self.out_of_range, "with indices out of range"),
            (self.non_finite, "with coordinates that are not finite or beyond 1e12 m"),
        ];
        let named: Vec<_> = reasons.iter().filter(|(n, _)| *n > 0).map(|(n, reason)| format!("{n} {reason}")).collect();
        (!named.is_empty()).then(|| format!("has triangles that are left out: {}", named.join(" and ")))
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

    let vertex_count = positions.len();
    let mut geometry = Geometry { rig: RigVertices::of(mesh, vertex_count), ..Default::default() };
    // Vertices of a mesh that bends may be equal at rest only.
    let joins_equal = indices.is_none() && geometry.rig.is_none();
    let mut places = vec![NONE; vertex_count];
    let mut equal: HashMap<[u32; size_of::<GpuVertex>() / 4], u32> = HashMap::default();
    for_each_triangle(strip, vertex_count, indices, |corners| {
        if corners.iter().any(|&c| c >= vertex_count) {
            geometry.dropped.out_of_range += 1;
            return;
        }
        let p = corners.map(|c| first_three(read(positions, c)));
        if !p.iter().flatten().all(|x| x.abs() <= MAX_COORDINATE) {
            geometry.dropped.non_finite += 1;
            return;
        }
        // A triangle that bends may have an area in another pose, such as that of a closed eyelid.
        if geometry.rig.is_none() && !has_area(&p) {
            geometry.dropped.degenerate += 1;
            return;
        }
        if second_uvs.is_some() {
            geometry.second_uvs.push(corners.map(|c| uv_of(second_uvs, c)));
        }
        if let Some(colors) = colors {
            geometry.colors.push(corners.map(|c| half_color(read(colors, c))));
        }
        let Geometry { vertices, sources, .. } = &mut geometry;
        let mut add = |vertex: GpuVertex, source: usize| {
            vertices.push(vertex);
            sources.push(source as u32);
            vertices.len() as u32 - 1
        };
        let triangle = [0, 1, 2].map(|i| {
            let place = &mut places[corners[i]];
            if *place == NONE {
                let vertex = vertex_of(corners[i], p[i], [normals, uvs, tangents]);
                *place = match joins_equal {
                    true => *equal.entry(bytemuck::cast(vertex)).or_insert_with(|| add(vertex, corners[i])),
                    false => add(vertex, corners[i]),
                };
            }
            *place
        });
        geometry.triangles.push(triangle);
    });
    if geometry.colors.as_flattened().iter().all(|color| *color == WHITE) {
        geometry.colors.clear();
    }
    Ok(geometry)
}

/// A packed vertex.  Without a normal, the mesh's tangent is ignored, as in glTF, because tangents are perpendicular to normals.
fn vertex_of(index: usize, position: V3, [normals, uvs, tangents]: [Option<&VertexAttributeValues>; 3]) -> GpuVertex {
    let normal = normals.and_then(|values| unit(first_three(read(values, index))));
    let tangent = tangents.map(|values| read(values, index)).and_then(|t| Some((unit(first_three(t))?, t[3] < 0.0)));
    let tangent = normal.and_then(|n| tangent.map(|(t, flipped)| pack_tangent(perpendicular(t, n), flipped)));
    GpuVertex {
        position,
        normal: normal.map_or(NOT_GIVEN, octahedral_encode),
        tangent: tangent.unwrap_or(NOT_GIVEN),
        uv: uv_of(uvs, index),
        ..Default::default()
    }
}

fn uv_of(values: Option<&VertexAttributeValues>, index: usize) -> [f32; 2] {
    let [u, v, ..] = values.map_or([0.0; 4], |values| read(values, index));
    [finite_or_zero(u), finite_or_zero(v)]
}

/// Colors of unlit objects may exceed 1, for glow.
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

/// Visits the vertex indices of each triangle, in order.  Triangles with equal indices, which join the parts of a strip, are skipped.
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

/// Number of components that `read` returns; 0 for an unsupported format.
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

/// The value of one vertex as floats; missing components are 0.  Beyond the last vertex it is NaN, which every caller replaces.
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

/// f64 avoids overflow and the cancellation in the differences.
fn has_area(p: &[V3; 3]) -> bool {
    let n = cross(subtract(p[1], p[0]), subtract(p[2], p[0]));
    dot(n, n) > MIN_SQUARED_DOUBLE_AREA
}

/// The normalized part of `t` perpendicular to `n`; any vector perpendicular to `n` if that part vanishes.
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
