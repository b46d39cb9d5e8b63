//! Whether the memory that the report states is the memory that the device has given: its allocator names each buffer and texture by its label.

use bevy::render::renderer::RenderDevice;
use bevy_restir::RestirReport;

/// Entries of the report that stand for several buffers or textures, or for one with another label.
struct Group {
    /// The end of the names of such entries.
    end: &'static str,
    labels: &'static [&'static str],
    /// The greatest number of buffers and textures of an entry.
    most: usize,
}

/// An entry that is not named here stands for one buffer or texture with its name as label.
const GROUPS: [Group; 10] = [
    Group { end: " reservoirs", labels: &["reservoirs", "last reservoirs", "forwarded reservoirs"], most: 3 },
    Group {
        end: " light",
        labels: &["light of candidates", "resampled light", "unresampled light", "light to denoise", "denoised light"],
        most: 3,
    },
    Group { end: " settings", labels: &["resampling settings", "denoiser settings"], most: 1 },
    // The two change roles from frame to frame, with their labels.
    Group { end: "visibility", labels: &["visibility", "last visibility"], most: 1 },
    Group { end: "denoiser guides", labels: &["denoiser guide", "last denoiser guide"], most: 2 },
    Group { end: "denoiser means", labels: &["denoiser means", "last denoiser means"], most: 2 },
    Group {
        end: "optical images",
        labels: &["optical images", "last optical images", "places of optical images"],
        most: 3,
    },
    Group { end: "shown surfaces", labels: &["shown visibility", "shown depth"], most: 2 },
    Group { end: "counters", labels: &["counters", "counters read-back"], most: 2 },
    // One for each image that a case can have.
    Group { end: "environment importance", labels: &["environment importance"], most: 4 },
];

/// An entry whose memory wgpu allocates without a label of the plugin.
const NOT_LABELED: &str = "top-level instances";
/// A buffer that the plugin always has.
const ALWAYS: &str = "scene uniforms";
/// Bytes by which a driver may enlarge a buffer or a texture that it also enlarges by less than its size.
const PADDING: u64 = 64 << 10;

/// A line about memory that the report does not state, or states without need; `None` where both agree, and where the device does not tell
/// its allocations by their labels.  Call it where nothing has changed for some frames, because memory that is freed waits for the GPU.
pub fn difference(device: &RenderDevice, report: &RestirReport) -> Option<String> {
    let allocated = device.wgpu_device().generate_allocator_report()?.allocations;
    if !allocated.iter().any(|part| part.name == ALWAYS) {
        return None;
    }
    let compare = |name: &str, is_entry: &dyn Fn(&str) -> bool, labels: &[&str], most: usize| {
        let entries = report.memory.iter().filter(|(entry, _)| is_entry(entry)).map(|(_, bytes)| *bytes);
        let parts = allocated.iter().filter(|part| labels.contains(&part.name.as_str())).map(|part| part.size);
        found(name, &entries.collect::<Vec<_>>(), &parts.collect::<Vec<_>>(), most)
    };
    let of_group = |group: &Group| {
        let is_entry = |entry: &str| entry.ends_with(group.end);
        compare(group.end.trim_start(), &is_entry, group.labels, group.most)
    };
    let of_single = |name: &str| compare(name, &|entry: &str| entry == name, &[name], 1);
    let is_single = |name: &str| name != NOT_LABELED && !GROUPS.iter().any(|group| name.ends_with(group.end));
    let mut singles = report.memory.iter().map(|(name, _)| *name).filter(|name| is_single(name));
    GROUPS.iter().find_map(of_group).or_else(|| singles.find_map(of_single))
}

/// A line about a difference between the bytes of some entries and those of the buffers and textures for them, at most `most` for each entry.
fn found(name: &str, entries: &[u64], parts: &[u64], most: usize) -> Option<String> {
    let (stated, actual) = (entries.iter().sum::<u64>(), parts.iter().sum::<u64>());
    let expected = most * entries.len();
    if actual < stated {
        return Some(format!("memory of {name}: the report states {stated} bytes, and the device has {actual}"));
    }
    if parts.len() > expected {
        let count = parts.len();
        return Some(format!("memory of {name}: {count} buffers and textures, of which the report states {expected}"));
    }
    let greatest = 2 * stated + PADDING * expected as u64;
    (actual > greatest)
        .then(|| format!("memory of {name}: the device has {actual} bytes, and the report states only {stated}"))
}
