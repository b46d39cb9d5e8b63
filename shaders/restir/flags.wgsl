// Tests of the flags of resampling.
#define_import_path bevy_restir::restir::flags

#import bevy_restir::restir::bindings::settings

fn has(flag: u32) -> bool {
    return (settings.flags & flag) != 0u;
}
