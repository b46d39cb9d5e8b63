//! Broken files in the viewer: each gives a message or a finite picture, as in `render`.

use super::stage;
use crate::support::{
    app::*,
    cli::{Folder, asset},
};
use bevy_restir_apps::viewer::load::{Open, Stage};
use core::ops::Range;
use std::{
    fs,
    path::Path,
    time::{Duration, Instant},
};

/// A file must be shown or rejected within this time.
const PATIENCE: Duration = Duration::from_secs(120);

/// Opens a file, and returns whether it is shown.  Otherwise there is a line that tells why not.
fn is_shown(rig: &mut Rig, path: &Path) -> bool {
    rig.app.world_mut().write_message(Open(path.into()));
    let start = Instant::now();
    rig.frame();
    while rig.app.world().resource::<Stage>().line.starts_with("loading") {
        assert!(start.elapsed() < PATIENCE, "{} is neither shown nor rejected", path.display());
        rig.frame();
    }
    // The other parts of the viewer react to the new scene.
    rig.frames(3);
    let stage = rig.app.world().resource::<Stage>();
    let is_shown = stage.shown.as_ref().is_some_and(|shown| shown.path.file_name() == path.file_name());
    assert_eq!(stage.line.lines().count(), usize::from(!is_shown), "{}: {}", path.display(), stage.line);
    is_shown
}

/// Loads broken copies of these files, or of the scenes of the project.  Returns the numbers of pictures and of messages.
fn load(rig: &mut Rig, files: &[&str], seeds: Range<u32>) -> [u32; 2] {
    let folder = Folder::without_gpu(&format!("viewer_broken_{}", seeds.start));
    let (first, count) = (seeds.start.to_string(), seeds.len().to_string());
    let make = ["broken-files", "--loader", "nothing", "--seed", &first, "--count", &count, "--out", "copies"];
    folder.lab(&[&make[..], files].concat()).succeeded();
    let mut outcomes = [0, 0];
    for seed in seeds {
        let copy = folder.path(&format!("copies/broken-{seed}.glb"));
        assert!(fs::exists(&copy).is_ok_and(|exists| exists), "{} was not written", copy.display());
        // The last one of these lines names the copy where the viewer panics.
        eprintln!("copy {seed} of {files:?}");
        if !is_shown(rig, &copy) {
            outcomes[1] += 1;
            continue;
        }
        outcomes[0] += 1;
        rig.until_ready();
        assert!(rig.next().is_finite(), "copy {seed} of {files:?}");
    }
    outcomes
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn broken_files_give_messages_or_pictures() {
    let Some(mut rig) = stage() else { return };
    let files = ["textured.glb", "cornell.glb"].map(|name| asset(name).display().to_string());
    let files = files.each_ref().map(String::as_str);
    let [pictures, messages] = load(&mut rig, &files, 1..33);
    assert!(pictures > 0 && messages > 0, "{pictures} pictures, {messages} messages");
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_broken_files_give_messages_or_pictures() {
    const COPIES: u32 = 5000;
    /// Copies of one app.
    const PART: u32 = 250;
    let mut all = [0, 0];
    for first in (1..=COPIES).step_by(PART as usize) {
        let Some(mut rig) = stage() else { return };
        let [pictures, messages] = load(&mut rig, &[], first..first + PART);
        all = [all[0] + pictures, all[1] + messages];
    }
    println!("{} pictures, {} messages", all[0], all[1]);
    assert!(all[0] > COPIES / 20 && all[1] > COPIES / 20, "{all:?}");
}
