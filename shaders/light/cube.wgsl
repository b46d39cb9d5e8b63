// A cube texture as an environment, with bilinear filtering across the edges of faces.  Cube textures are left-handed: as in Bevy's skybox,
// z is negated before the lookup.
#define_import_path bevy_restir::light::cube

#import bevy_restir::common::constants::LEAST_MAGNITUDE
#import bevy_restir::common::math::clean_radiance
#import bevy_restir::view::bindings::environment_map

// A point of the cube: the face (+X, -X, +Y, -Y, +Z, -Z), and coordinates on it from -1 to 1, right and down.
struct CubePoint {
    face: u32,
    at: vec2<f32>,
}

// Radiance from a direction of the environment.
fn cube_radiance(d: vec3<f32>) -> vec3<f32> {
    let n = cube_side();
    let point = cube_point(d * vec3<f32>(1.0, 1.0, -1.0));
    let at = (0.5 * point.at + 0.5) * f32(n) - 0.5;
    let low = floor(at);
    let f = at - low;
    let p = vec2<i32>(low);
    return mix(
        mix(cube_texel(point.face, p, n), cube_texel(point.face, p + vec2<i32>(1, 0), n), f.x),
        mix(cube_texel(point.face, p + vec2<i32>(0, 1), n), cube_texel(point.face, p + vec2<i32>(1, 1), n), f.x),
        f.y,
    );
}

// Texels per side of a face.
fn cube_side() -> i32 {
    return i32(textureDimensions(environment_map).x);
}

// The point of the cube in a direction.
fn cube_point(d: vec3<f32>) -> CubePoint {
    let size = abs(d);
    if size.x >= size.y && size.x >= size.z {
        return CubePoint(select(1u, 0u, d.x > 0.0), vec2<f32>(select(d.z, -d.z, d.x > 0.0), -d.y) / max(size.x, LEAST_MAGNITUDE));
    }
    if size.y >= size.z {
        return CubePoint(select(3u, 2u, d.y > 0.0), vec2<f32>(d.x, select(-d.z, d.z, d.y > 0.0)) / size.y);
    }
    return CubePoint(select(5u, 4u, d.z > 0.0), vec2<f32>(select(-d.x, d.x, d.z > 0.0), -d.y) / size.z);
}

// The direction of a point, not normalized.
fn cube_direction(face: u32, at: vec2<f32>) -> vec3<f32> {
    switch face {
        case 0u: {
            return vec3<f32>(1.0, -at.y, -at.x);
        }
        case 1u: {
            return vec3<f32>(-1.0, -at.y, at.x);
        }
        case 2u: {
            return vec3<f32>(at.x, 1.0, at.y);
        }
        case 3u: {
            return vec3<f32>(at.x, -1.0, -at.y);
        }
        case 4u: {
            return vec3<f32>(at.x, -at.y, 1.0);
        }
        default: {
            return vec3<f32>(-at.x, -at.y, -1.0);
        }
    }
}

// A texel of a face; beyond the edge, the nearest texel of the adjacent face.
fn cube_texel(face: u32, p: vec2<i32>, n: i32) -> vec3<f32> {
    var point = CubePoint(face, vec2<f32>(0.0));
    var texel = p;
    if any(p < vec2<i32>(0)) || any(p >= vec2<i32>(n)) {
        // A point just beyond the edge, next to the texel.  Beyond a corner there is no texel: one beyond an edge is used instead.
        let inner = 1.0 - 1.0 / f32(n);
        let outer = 1.0 + 0.25 / f32(n);
        var at = clamp((2.0 * vec2<f32>(p) + 1.0) / f32(n) - 1.0, vec2<f32>(-outer), vec2<f32>(outer));
        if p.x < 0 || p.x >= n {
            at.y = clamp(at.y, -inner, inner);
        }
        point = cube_point(cube_direction(face, at));
        texel = vec2<i32>((0.5 * point.at + 0.5) * f32(n));
    }
    let inside = clamp(texel, vec2<i32>(0), vec2<i32>(n - 1));
    return clean_radiance(textureLoad(environment_map, inside, point.face, 0).rgb);
}
