//! The files of `--aov`.

use crate::{Written, accumulate, args::Args};
use bevy::{prelude::*, time::TimeUpdateStrategy};
use bevy_restir::{DebugView, Restir};
use bevy_restir_support::{
    headless::{self, captured, frame},
    scene::View,
};
use core::time::Duration;

/// The positions of all animations, in seconds.
pub struct AnimationTimes(Vec<(Entity, AnimationNodeIndex, f32)>);

impl AnimationTimes {
    pub fn of(world: &mut World) -> Self {
        let mut players = world.query::<(Entity, &AnimationPlayer)>();
        let times = players.iter(world).flat_map(|(entity, player)| {
            player.playing_animations().map(move |(&node, animation)| (entity, node, animation.seek_time()))
        });
        Self(times.collect())
    }

    /// Whether nothing is played.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Sets all animations to their beginnings. Returns these positions.
    pub fn rewind(world: &mut World) -> Self {
        let mut all = Self::of(world);
        all.0.iter_mut().for_each(|(.., time)| *time = 0.0);
        all.restore(world);
        all
    }

    fn restore(&self, world: &mut World) {
        for &(entity, node, time) in &self.0 {
            let player = world.get_mut::<AnimationPlayer>(entity);
            if let Some(animation) = player.map(Mut::into_inner).and_then(|player| player.animation_mut(node)) {
                animation.set_seek_time(time);
            }
        }
    }
}

/// Renders and writes the files.  `settings`: of the picture; `scale`: of its radiance in the file; `start` and `end`: its moments.
pub fn write(
    app: &mut App,
    args: &Args,
    settings: &Restir,
    scale: f64,
    [start, end]: &[AnimationTimes; 2],
    written: &mut Written,
) -> Result<(), String> {
    // The surfaces are those of the frame after the picture, so they come first.
    let (parts, surfaces): (Vec<_>, Vec<_>) = args.aovs.iter().partition(|aov| aov.view.is_part_of_light());
    for aov in surfaces {
        // Animations go on while pipelines compile.
        show(app, Restir { debug_view: aov.view, accumulate: false, ..settings.clone() })?;
        end.restore(app.world_mut());
        frame_without_time(app);
        app.world().resource::<View>().capture.request();
        frame(app);
        let values = captured(app)?;
        let pixels: Vec<[f32; 3]> = values.mean().map(|value| of_surface(aov.view, value)).collect();
        written.exr(&aov.path, values.size, &pixels)?;
    }
    for aov in parts {
        show(app, Restir { debug_view: aov.view, ..settings.clone() })?;
        start.restore(app.world_mut());
        // The same random numbers as those of the picture give the same samples.
        let frames = accumulate(app, args, settings, false)?;
        written.exr(&aov.path, args.size, &frames.scaled(scale))?;
    }
    Ok(())
}

/// Renders the scene as it is now, so that the next frame measures its motion from here.
pub fn frame_without_time(app: &mut App) {
    let strategy = app.world_mut().remove_resource::<TimeUpdateStrategy>();
    app.insert_resource(TimeUpdateStrategy::ManualDuration(Duration::ZERO));
    frame(app);
    if let Some(strategy) = strategy {
        app.insert_resource(strategy);
    }
}

/// Gives the camera other settings and waits for their pipelines.
fn show(app: &mut App, settings: Restir) -> Result<(), String> {
    let camera = app.world().resource::<View>().camera;
    app.world_mut().entity_mut(camera).insert(settings);
    headless::until_ready(app)
}

/// The value of a file from that of its debug view.
fn of_surface(view: DebugView, value: [f32; 3]) -> [f32; 3] {
    match view {
        // Normals lie between 0 and 1 in their view, and pixels without a surface are 0.
        DebugView::Normals if value != [0.0; 3] => value.map(|c| 2.0 * c - 1.0),
        _ => value,
    }
}
