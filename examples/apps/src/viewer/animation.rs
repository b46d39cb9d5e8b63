//! Plays the animations of the file.

use bevy::{gltf::Gltf, prelude::*};

use super::load::{Arrived, Stage};

/// The clips of the file and the state of playing.
#[derive(Resource, Default)]
pub struct Clips {
    /// Names, lengths in seconds, and nodes of the graph.
    pub all: Vec<(String, f32, AnimationNodeIndex)>,
    pub chosen: usize,
    pub playing: bool,
    /// Position in the clip, s.
    pub time: f32,
    /// Whether the user has set `time`.
    pub seek_requested: bool,
    graph: Handle<AnimationGraph>,
}

pub fn plugin(app: &mut App) {
    app.init_resource::<Clips>().add_systems(Update, (take_clips, play).chain());
}

/// Collects the clips of a new scene. It rests until the user plays one.
fn take_clips(
    mut arrived: MessageReader<Arrived>,
    stage: Res<Stage>,
    gltfs: Res<Assets<Gltf>>,
    lengths: Res<Assets<AnimationClip>>,
    mut graphs: ResMut<Assets<AnimationGraph>>,
    mut clips: ResMut<Clips>,
) {
    if arrived.read().next().is_none() {
        return;
    }
    *clips = Clips::default();
    let Some(gltf) = stage.shown.as_ref().and_then(|shown| gltfs.get(&shown.file)) else { return };
    let (graph, nodes) = AnimationGraph::from_clips(gltf.animations.iter().cloned());
    clips.graph = graphs.add(graph);
    for (i, (clip, node)) in gltf.animations.iter().zip(nodes).enumerate() {
        let name = gltf.named_animations.iter().find(|(_, named)| *named == clip).map(|(name, _)| name.to_string());
        let length = lengths.get(clip).map_or(0.0, AnimationClip::duration);
        clips.all.push((name.unwrap_or_else(|| format!("animation {}", i + 1)), length, node));
    }
}

/// Applies the state to the animation players, and reads the position back for the panel.
fn play(
    mut commands: Commands,
    mut clips: ResMut<Clips>,
    mut players: Query<(Entity, &mut AnimationPlayer, Has<AnimationGraphHandle>)>,
) {
    let Some(&(_, length, node)) = clips.all.get(clips.chosen) else { return };
    if clips.playing || clips.seek_requested {
        for (entity, mut player, has_graph) in &mut players {
            if !has_graph {
                commands.entity(entity).insert(AnimationGraphHandle(clips.graph.clone()));
            }
            if !player.is_playing_animation(node) {
                player.stop_all().start(node).repeat();
            }
            if let Some(active) = player.animation_mut(node) {
                if clips.seek_requested {
                    active.seek_to(clips.time);
                }
                if clips.playing {
                    active.resume();
                }
            }
        }
        clips.seek_requested = false;
    }
    if !clips.playing {
        for (_, mut player, _) in &mut players {
            if !player.all_paused() {
                player.pause_all();
            }
        }
    }
    let active = players.iter().find_map(|(_, player, _)| player.animation(node));
    if let Some(active) = active {
        clips.time = active.seek_time().clamp(0.0, length);
    }
}
