// A ray, what it hits, and the counters that every trace back end keeps.
#define_import_path bevy_restir::common::ray

// `direction` need not be a unit vector; distances are in units of its length.  Only t in the open interval (t_min, t_max) counts.
struct Ray {
    origin: vec3<f32>,
    t_min: f32,
    direction: vec3<f32>,
    t_max: f32,
}

// `instance` is NONE for a miss, and t is then the ray's t_max.  `triangle` indexes `triangles` and `attributes`;
// `barycentrics` are the weights of its second and third corner.
struct Hit {
    t: f32,
    instance: u32,
    triangle: u32,
    barycentrics: vec2<f32>,
}

// Rays that this invocation has traced, and the OVERFLOW_* bits of what went wrong on the way.
var<private> rays_traced: u32;
var<private> trace_flags: u32;
