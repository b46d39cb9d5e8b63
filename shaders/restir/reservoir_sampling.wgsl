// Weighted reservoir sampling (Chao 1982; Wyman and Panteleev 2021, 3.2): selects one sample of a stream with probability proportional to
// its weight.
#define_import_path bevy_restir::restir::reservoir_sampling

#import bevy_restir::common::guard::{GUARD_CONTRIBUTION_WEIGHT, GUARD_RESAMPLING_WEIGHT, guarded}

struct Stream {
    sum: f32,          // of weights
    selected: u32,     // index of the selected input
}

// Adds an input; true if it is selected.  An input with the weight 0 is never selected, not even with u = 0.
fn stream_add(stream: ptr<function, Stream>, index: u32, weight: f32, u: f32) -> bool {
    let w = guarded(weight, GUARD_RESAMPLING_WEIGHT);
    if !(w > 0.0) {
        return false;
    }
    (*stream).sum += w;
    if u * (*stream).sum < w {
        (*stream).selected = index;
        return true;
    }
    return false;
}

// Unbiased contribution weight of the selected sample.
fn stream_ucw(stream: Stream, selected_target: f32) -> f32 {
    if !(selected_target > 0.0) || !(stream.sum > 0.0) {
        return 0.0;
    }
    return guarded(sum_over_target(stream.sum, selected_target), GUARD_CONTRIBUTION_WEIGHT);
}

// PLANT_*: errors that only tests define, and must find.
#ifdef PLANT_SCALED_UCW
fn sum_over_target(sum: f32, selected_target: f32) -> f32 {
    return 1.03 * sum / selected_target;
}
#else
#ifdef PLANT_SLIGHTLY_SCALED_UCW
fn sum_over_target(sum: f32, selected_target: f32) -> f32 {
    return 1.003 * sum / selected_target;
}
#else
fn sum_over_target(sum: f32, selected_target: f32) -> f32 {
    return sum / selected_target;
}
#endif
#endif
