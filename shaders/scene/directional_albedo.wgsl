// Energy that single scattering loses in a GGX lobe (Turquin 2019), from a table of the directional albedo E with F = 1, over n·wo and
// roughness.
#define_import_path bevy_restir::scene::directional_albedo

#import bevy_restir::common::constants::ALPHA_DELTA
#import bevy_restir::scene::bindings::specular_albedo

#ifdef ENERGY_COMPENSATION
// (1 - E)/E with bilinear interpolation of E; 0 for a delta.
fn multiple_scattering(alpha: f32, cos_o: f32) -> f32 {
    if alpha < ALPHA_DELTA {
        return 0.0;
    }
    let last = textureDimensions(specular_albedo) - 1u;
    let at = clamp(vec2<f32>(cos_o, sqrt(alpha)), vec2<f32>(0.0), vec2<f32>(1.0)) * vec2<f32>(last);
    let low = min(vec2<u32>(at), last - 1u);
    let f = at - vec2<f32>(low);
    let e = mix(
        mix(albedo_entry(low, 0u, 0u), albedo_entry(low, 1u, 0u), f.x),
        mix(albedo_entry(low, 0u, 1u), albedo_entry(low, 1u, 1u), f.x),
        f.y,
    );
    return (1.0 - e) / e;
}

fn albedo_entry(low: vec2<u32>, x: u32, y: u32) -> f32 {
    return textureLoad(specular_albedo, low + vec2<u32>(x, y), 0).x;
}
#else
fn multiple_scattering(alpha: f32, cos_o: f32) -> f32 {
    return 0.0;
}
#endif
