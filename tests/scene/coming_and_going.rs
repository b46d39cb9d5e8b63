//! Instances that come and go, one by one and in crowds: rays reach each instance once, in this frame and in the last one, and a frame sends
//! little of a large tree.

use crate::support::app::*;
use bevy::prelude::*;
use bevy_restir::testing::geometry::top_level::{TopLevels, read_top_levels};

/// Bytes of a node, and of an entry of a leaf.
const NODE: u64 = 80;
const ENTRY: u64 = 4;

/// Small squares before a wall, under a bright sky.
struct Field {
    rig: Rig,
    look: (Mesh3d, MeshMaterial3d<StandardMaterial>),
    squares: Vec<(Entity, Transform)>,
    wall: Entity,
    /// Those of the last frame.
    top: TopLevels,
}

/// One of a thousand places for squares.  Later ones lie a little before these.
fn place(i: usize) -> Transform {
    let [column, row, layer] = [i % 40, i / 40 % 25, i % 7].map(|n| n as f32);
    let layer = 0.1 * layer + 0.013 * (i / 1000) as f32;
    Transform::from_xyz(0.05 * column - 0.975, 0.08 * row - 0.96, layer)
}

fn places(count: usize) -> Vec<Transform> {
    (0..count).map(place).collect()
}

fn spawn_wall(rig: &mut Rig) -> Entity {
    rig.spawn(square(4.0), lambert(0.7), Transform::from_xyz(0.0, 0.0, -0.3))
}

impl Field {
    /// Squares at these places.  `share`: they share a tree while they rest.
    fn new(places: &[Transform], share: bool) -> Option<Self> {
        let mut rig = Rig::new(32, 32)?;
        if share {
            rig.share_a_tree_at_rest();
        }
        rig.insert(rig.camera, (orthographic(2.2, 2.2), sky(1.0)));
        let wall = spawn_wall(&mut rig);
        let look = (Mesh3d(rig.add::<Mesh>(square(0.04))), MeshMaterial3d(rig.add::<StandardMaterial>(lambert(0.5))));
        let squares = places.iter().map(|place| (rig.spawn_bundle((look.clone(), *place)), *place)).collect();
        rig.until_ready();
        rig.frames(3);
        let top = read_top_levels(&rig.app)?;
        Some(Self { rig, look, squares, wall, top })
    }

    fn come(&mut self, place: Transform) {
        self.squares.push((self.rig.spawn_bundle((self.look.clone(), place)), place));
    }

    /// One of the squares goes, and the last one takes its number.
    fn go(&mut self, index: usize) {
        let index = index % self.squares.len();
        let (entity, _) = self.squares.swap_remove(index);
        self.rig.app.world_mut().despawn(entity);
    }

    fn shift(&mut self, index: usize) {
        let index = index % self.squares.len();
        let (entity, place) = &mut self.squares[index];
        place.translation.z += 0.002;
        *self.rig.get_mut::<Transform>(*entity) = *place;
    }

    /// Renders a frame, and checks its top levels on the GPU.  Returns the number of bytes that it has sent of them.
    fn frame(&mut self) -> u64 {
        self.rig.frame();
        let top = read_top_levels(&self.rig.app).expect("the plugin runs");
        assert!(top.current == top.expected, "the GPU has another top level than the CPU");
        top.current.assert_holds(&top.traced);
        assert!(top.previous == self.top.current, "the top level of the last frame has changed");
        top.previous.assert_holds(&self.top.traced);
        self.top = top;
        self.top.sent_bytes
    }

    /// Bytes of the whole top level.
    fn bytes(&self) -> u64 {
        NODE * self.top.current.nodes.len() as u64 + ENTRY * self.top.traced.len() as u64
    }

    /// Asserts that the field looks like another one that has had its squares from the start.
    fn assert_looks_fresh(mut self) {
        let places: Vec<_> = self.squares.iter().map(|(_, place)| *place).collect();
        let mut fresh = Self::new(&places, false).expect("there is an adapter");
        let expected = fresh.rig.picture(2);
        assert!(expected.mean() > 0.1, "the picture is black");
        assert_eq!(self.rig.picture(2), expected);
        self.rig.assert_sound();
    }
}

#[test]
fn one_of_a_thousand_comes_or_goes_in_each_frame() {
    let Some(mut field) = Field::new(&places(1000), false) else { return };
    let mut sent = Vec::new();
    for frame in 0..40 {
        match frame % 4 {
            1 => field.go(37 * frame),
            3 => field.go(field.squares.len() - 1),
            _ => field.come(place(1000 + 7 * frame)),
        }
        // Others move, the newest one among them.
        let some_move = frame % 8 > 3;
        for mover in [3, 501, field.squares.len() - 1].into_iter().filter(|_| some_move) {
            field.shift(mover);
        }
        let bytes = field.frame();
        assert!(field.top.newcomers > 0, "frame {frame}: a tree over all was built");
        // The first two write the two copies with room for newcomers.  A copy also gets what changed in the frame before.
        if frame > 1 && (1..4).contains(&(frame % 8)) {
            sent.push(bytes);
        }
    }
    assert!(sent.iter().all(|bytes| (1..field.bytes() / 2).contains(bytes)), "{sent:?} of {}", field.bytes());
    field.assert_looks_fresh();
}

#[test]
fn one_that_comes_or_goes_among_many_sends_few_bytes() {
    let Some(mut field) = Field::new(&places(4000), false) else { return };
    let mut sent = Vec::new();
    for frame in 0..10 {
        match frame % 2 {
            0 => field.come(place(4000 + 7 * frame)),
            _ => field.go(37 * frame),
        }
        sent.push(field.frame());
    }
    let whole = field.bytes();
    assert!(whole > 50_000 && sent[2..].iter().all(|bytes| *bytes < whole / 6), "{sent:?} of {whole}");
    field.rig.frames(2);
    assert_eq!(field.rig.report().uploaded_bytes, 0);
}

#[test]
fn slots_of_instances_that_have_gone_belong_to_newcomers_at_once() {
    let Some(mut field) = Field::new(&places(1000), false) else { return };
    let slots = |field: &Field| field.top.traced.iter().map(|(slot, _)| *slot).max();
    let at_first = slots(&field);
    for round in 0..6 {
        (0..12).for_each(|i| field.go(71 * i + round));
        field.frame();
        (0..12).for_each(|i| field.come(place(1000 + 83 * i + round)));
        field.frame();
        assert_eq!(slots(&field), at_first, "no other slots are used");
    }
    assert!(field.top.newcomers >= 60, "{}", field.top.newcomers);
    field.assert_looks_fresh();
}

#[test]
fn many_newcomers_and_those_that_rest_enter_the_main_tree() {
    let Some(mut field) = Field::new(&places(1000), false) else { return };
    (0..150).for_each(|i| field.come(place(1000 + 3 * i)));
    field.frame();
    assert_eq!(field.top.newcomers, 150);
    // Something changes in each frame of the build.
    let mut frames = 0;
    while field.top.newcomers > 20 {
        frames += 1;
        assert!(frames < 20, "{} newcomers", field.top.newcomers);
        match frames % 3 {
            0 => field.come(place(2000 + frames)),
            1 => field.go(150 * frames),
            _ => field.go(field.squares.len() - 1),
        }
        field.shift(1020);
        field.frame();
    }
    assert!(field.top.newcomers > 0, "the one that moves stays outside");
    field.rig.frames(130);
    field.top = read_top_levels(&field.rig.app).expect("the plugin runs");
    for _ in 0..10 {
        field.frame();
    }
    assert_eq!(field.top.newcomers, 0);
    field.assert_looks_fresh();
}

#[test]
fn everything_goes_and_newcomers_are_alone() {
    let Some(mut field) = Field::new(&places(200), false) else { return };
    (0..20).for_each(|i| field.come(place(1000 + i)));
    field.frame();
    assert_eq!(field.top.newcomers, 20);
    // The wall and all squares that are not newcomers go.
    field.rig.app.world_mut().despawn(field.wall);
    let newcomers = field.squares.split_off(200);
    for (entity, _) in core::mem::replace(&mut field.squares, newcomers) {
        field.rig.app.world_mut().despawn(entity);
    }
    field.frame();
    assert_eq!((field.top.newcomers, field.top.current.entries.len()), (0, 20));
    (0..20).for_each(|_| field.go(0));
    field.frame();
    assert_eq!((field.top.current.entries.len(), field.top.previous.entries.len()), (0, 20));
    field.frame();
    assert_eq!(field.top.previous.entries.len(), 0);
    field.wall = spawn_wall(&mut field.rig);
    (0..100).for_each(|i| field.come(place(i)));
    field.rig.until_ready();
    field.top = read_top_levels(&field.rig.app).expect("the plugin runs");
    field.come(place(1000));
    field.frame();
    assert_eq!(field.top.current.entries.len(), 102);
    // The mesh of the wall may take longer than that of the squares.
    assert!((1..=2).contains(&field.top.newcomers), "{}", field.top.newcomers);
    field.assert_looks_fresh();
}

#[test]
fn newcomers_lie_beside_instances_that_share_a_tree_at_rest() {
    let Some(mut field) = Field::new(&places(200), true) else { return };
    assert_eq!(field.top.current.entries.len(), 1, "all share a tree");
    for i in 0..3 {
        field.come(place(1000 + i));
        field.frame();
        assert_eq!(field.top.current.entries.len(), 2 + i);
    }
    field.go(5);
    field.frame();
    assert_eq!(field.top.current.entries.len(), 203, "the tree is left");
    field.come(place(1100));
    field.shift(9);
    field.frame();
    assert_eq!(field.top.newcomers, 1);
    // The others share a tree again after some time.
    for _ in 0..300 {
        field.frame();
        if field.top.current.entries.len() < 10 {
            break;
        }
    }
    assert!(field.top.current.entries.len() < 10, "{} entries", field.top.current.entries.len());
    field.go(201);
    field.frame();
    field.rig.assert_sound();
}
