//! `lab fuzz --both-backends`: random scenes by software rays and by ray queries, where the adapter has them.

use crate::support::{cli::Folder, gpu::back_ends};

#[test]
fn random_scenes_look_the_same_by_both_back_ends() {
    let Some(folder) = Folder::new("both_backends") else { return };
    folder.lab(&["fuzz", "--both-backends", "--backend", "software"]).failed(2, "both back ends, and one of them");
    let cases = ["fuzz", "--both-backends", "--technique", "reference", "--count", "2", "--size", "8x6"];
    let run = folder.lab(&[&cases[..], &["--out", "cases"]].concat());
    if back_ends().len() > 1 {
        run.succeeded();
        assert!(run.stdout.contains("2 cases, none fails"), "{}", run.stdout);
    } else {
        run.failed(1, "a device without ray queries");
        assert!(run.stderr.contains("--both-backends needs ray queries"), "{}", run.stderr);
    }
}
