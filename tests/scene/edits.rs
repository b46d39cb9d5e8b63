//! The picture does not depend on how the scene came about: after hundreds of random edits, many during loading, it equals that of a
//! fresh load.

use crate::support::{app::*, random_edits::Edited, small_scenes::environment_of};
use bevy::prelude::*;
use bevy_restir::{Restir, SceneFeatures, Technique};
use std::time::Instant;

/// Each technique that has a history.
const RESAMPLED: [Technique; 4] = [Technique::Di, Technique::Gi, Technique::Pt, Technique::Bdpt];

/// A run of random edits.
struct Course {
    size: UVec2,
    edits: usize,
    /// The techniques that render meanwhile, in turn.
    techniques: &'static [Technique],
    /// Edits after which the next technique follows.
    turn: usize,
    /// The techniques whose pictures are compared in the end.
    compared: &'static [Technique],
}

impl Course {
    fn rig(&self) -> Option<Rig> {
        let mut rig = Rig::new(self.size.x, self.size.y)?;
        environment_of(&mut rig, true);
        rig.set(|restir| *restir = Restir { technique: self.techniques[0], bounces: 3, ..plain() });
        Some(rig)
    }

    /// Edits a scene, compares it with a fresh load, and asserts that histories restarted only for reasons that the edits give.
    fn run(&self) {
        let Some(mut edited) = self.rig() else { return };
        let mut scene = Edited::new(&mut edited, 7);
        edited.until_ready();
        let (start, before) = (Instant::now(), edited.report().history_resets);
        for i in 0..self.edits {
            let technique = self.techniques[i / self.turn % self.techniques.len()];
            if i % self.turn == 0 {
                eprintln!("{i} edits, {technique:?}: {:.1} s", start.elapsed().as_secs_f64());
                edited.set(|restir| restir.technique = technique);
            }
            scene.edit(&mut edited);
            // Some edits share a frame, some come a frame apart, and from time to time all loading may finish.
            if i % 3 != 1 {
                edited.frame();
            }
            if i % 60 == 59 {
                assert!(edited.next().is_finite(), "after {i} edits");
                edited.until_ready();
            }
        }
        edited.assert_sound();
        // The first technique is there from the start.
        let turns = self.edits.div_ceil(self.turn) as u64 - 1;
        for ((reason, before), (_, after)) in before.into_iter().zip(edited.report().history_resets) {
            let allowed = match reason {
                // An image that is new or edited may need another packing of the atlas.
                "scene" => scene.images,
                "settings" | "pipelines" => turns,
                _ => 0,
            };
            eprintln!("{reason}: {} of at most {allowed} restarts", after - before);
            assert!(after - before <= allowed, "histories restart {} times because of {reason}", after - before);
        }

        let of_edited = self.pictures(&mut edited);
        // One device after the other, so that the second one finds the pipelines of the first.
        drop(edited);
        let mut fresh = self.rig().expect("there is an adapter");
        scene.load(&mut fresh);
        for (technique, (of_edited, of_fresh)) in
            self.compared.iter().zip(of_edited.into_iter().zip(self.pictures(&mut fresh)))
        {
            assert_equal(*technique, of_edited, of_fresh);
        }
    }

    /// A picture of each compared technique.
    fn pictures(&self, rig: &mut Rig) -> Vec<Shown> {
        let shown = |rig: &mut Rig, technique| {
            rig.set(|restir| restir.technique = technique);
            let picture = rig.picture(6);
            let report = rig.report();
            Shown { picture, counts: [report.instances, report.triangles, report.lights], features: report.features }
        };
        let pictures = self.compared.iter().map(|technique| shown(rig, *technique)).collect();
        rig.frames(2);
        assert_eq!(rig.report().uploaded_bytes, 0, "nothing is left to upload");
        rig.assert_sound();
        pictures
    }
}

/// A picture with the numbers of instances, triangles and lights and the features of its scene.
struct Shown {
    picture: Picture,
    counts: [u64; 3],
    features: SceneFeatures,
}

fn assert_equal(technique: Technique, edited: Shown, fresh: Shown) {
    assert_eq!(edited.counts, fresh.counts, "instances, triangles, lights");
    assert!(edited.features.contains(fresh.features));
    assert!(edited.counts[0] > 8 && edited.counts[2] > 20, "{:?}", edited.counts);
    let (a, b) = (edited.picture, fresh.picture);
    let other = a.iter().zip(b.iter()).filter(|(a, b)| a != b).count();
    assert_eq!(other, 0, "{technique:?}: {other} of {} pixels differ", a.pixels.len());
    assert!(a.mean() > 0.05 && a.is_finite());
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn three_hundred_edits_end_in_the_picture_of_a_fresh_load() {
    let compared = &[Technique::Reference, Technique::Pt];
    let size = UVec2::new(32, 24);
    Course { size, edits: 300, techniques: &[Technique::Reference], turn: 300, compared }.run();
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn sixty_edits_under_every_technique_end_in_the_picture_of_a_fresh_load() {
    Course { size: UVec2::new(16, 12), edits: 60, techniques: &RESAMPLED, turn: 15, compared: &RESAMPLED }.run();
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_a_thousand_edits_under_every_technique_end_in_the_picture_of_a_fresh_load() {
    Course { size: UVec2::new(32, 24), edits: 1000, techniques: &RESAMPLED, turn: 25, compared: &RESAMPLED }.run();
}

/// As in Bevy, where such an object is drawn until the last handle of its material is dropped.
#[test]
fn an_object_whose_material_is_taken_out_of_the_assets_stays() {
    let Some(mut rig) = Rig::new(16, 12) else { return };
    let entity = rig.spawn(square(8.0), lamp(2.0, 2.0, 2.0), Transform::default());
    let before = rig.picture(1).mean();
    let handle = rig.material_of(entity);
    rig.app.world_mut().resource_mut::<Assets<StandardMaterial>>().remove(&handle);
    rig.frames(3);
    let after = rig.picture(1).mean();
    assert!(before > 1.0 && after == before, "{before} and {after}");
}
