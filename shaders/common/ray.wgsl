// Rays, hits, and the counters that both trace back ends update.
#define_import_path bevy_restir::common::ray

// `direction` need not be a unit vector; distances are in units of its length.  Only hits with t in (t_min, t_max) count.
struct Ray {
    origin: vec3<f32>,
    t_min: f32,
    direction: vec3<f32>,
    t_max: f32,
}

// The result of tracing a ray.  A miss has `instance` = NONE, and `t` is the ray's t_max.  `triangle` is an index into `triangles`, as of
// this frame (`stored_triangle`).  `barycentrics` are the weights of the second and third corner.
struct Hit {
    t: f32,
    instance: u32,
    triangle: u32,
    barycentrics: vec2<f32>,
}

// Number of rays that this invocation has traced, and the OVERFLOW_* bits of their errors and of lists that are too long.
var<private> rays_traced: u32;
var<private> trace_flags: u32;
