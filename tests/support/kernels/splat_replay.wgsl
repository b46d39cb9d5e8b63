// Replays the sample that each pixel stored in the last frame in the scene of that frame.  Tests run it instead of
// `shaders/pass/splats_gather.wgsl`.  The contribution of the stored result is (1 in the right pixel, relative error, 1).

#import bevy_restir::common::math::luminance
#import bevy_restir::light::remap::current_light_id
#import bevy_restir::restir::bdpt::splat::replayed_splat
#import bevy_restir::restir::bindings::settings
#import bevy_restir::restir::reservoir_layout::reservoir_index
#import bevy_restir::restir::splats::domain::contribution_of
#import bevy_restir::restir::splats::reservoir::{no_reservoir, PackedReservoir, reservoir_pack, reservoir_unpack}
#import bevy_restir::view::bindings::view

@group(2) @binding(1) var<storage, read> last: array<PackedReservoir>;
@group(2) @binding(2) var<storage, read_write> forwarded: array<PackedReservoir>;

@compute @workgroup_size(8, 8)
fn splats_gather(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= view.size) || settings.temporal_samples == 0u {
        return;
    }
    let index = reservoir_index(pixel);
    let r = reservoir_unpack(last[index]);
    var result = no_reservoir();
    if r.ucw > 0.0 {
        let light = current_light_id(r.light);
        let s = replayed_splat(r.path, r.frame, light, r.events, true);
        let is_same = s.pixel == pixel.y * view.size.x + pixel.x;
        // The probability of the light is that of this frame in both.
        let error = abs(luminance(contribution_of(s, light)) / luminance(r.f) - 1.0);
        result.f = vec3<f32>(f32(is_same), select(9.0, error, is_same), 1.0);
    }
    forwarded[index] = reservoir_pack(result);
}
