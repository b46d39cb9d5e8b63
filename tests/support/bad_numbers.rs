//! Sets every number of a component or an asset to bad values while an app runs.  Reflection finds the numbers, so that a new field needs no
//! code here.

use super::app::{Picture, Rig};
use bevy::{
    ecs::component::Mutable,
    prelude::*,
    reflect::{PartialReflect, ReflectMut},
};
use bevy_restir::testing::guards::GUARDS;

/// Numbers that no field expects everywhere.  0, 1e30 and the denormal number are valid for some fields.
pub const BAD: [f32; 7] = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 0.0, -1.0, 1e30, 1e-40];
const BAD_COUNTS: [u32; 4] = [0, 1, 1 << 31, u32::MAX];

/// A number in a reflected value.
pub enum Number<'a> {
    Real(&'a mut f32),
    Count(&'a mut u32),
}

/// Visits all numbers of a value with their paths.
fn each_number(value: &mut dyn PartialReflect, path: &str, visit: &mut dyn FnMut(&str, Number)) {
    if let Some(number) = value.try_downcast_mut::<f32>() {
        return visit(path, Number::Real(number));
    }
    if let Some(number) = value.try_downcast_mut::<u32>() {
        return visit(path, Number::Count(number));
    }
    let join = |name: &str| if path.is_empty() { name.to_string() } else { format!("{path}.{name}") };
    match value.reflect_mut() {
        ReflectMut::Struct(fields) => {
            for i in 0..fields.field_len() {
                let name = join(fields.name_at(i).unwrap_or_default());
                each_number(fields.field_at_mut(i).expect("the index is in range"), &name, visit);
            }
        }
        ReflectMut::TupleStruct(fields) => {
            for i in 0..fields.field_len() {
                each_number(fields.field_mut(i).expect("the index is in range"), path, visit);
            }
        }
        ReflectMut::Enum(fields) => {
            for i in 0..fields.field_len() {
                let name = fields.name_at(i).map_or_else(|| path.to_string(), join);
                each_number(fields.field_at_mut(i).expect("the index is in range"), &name, visit);
            }
        }
        _ => {}
    }
}

type Access = Box<dyn Fn(&mut World, &mut dyn FnMut(&mut dyn PartialReflect))>;

/// A component, a resource or an asset whose numbers become bad.
pub struct Target {
    pub name: &'static str,
    access: Access,
}

impl Target {
    pub fn component<C: Component<Mutability = Mutable> + PartialReflect>(name: &'static str, entity: Entity) -> Self {
        let access = move |world: &mut World, visit: &mut dyn FnMut(&mut dyn PartialReflect)| {
            visit(&mut *world.get_mut::<C>(entity).expect("the entity has the component"));
        };
        Self { name, access: Box::new(access) }
    }

    pub fn resource<R: Resource<Mutability = Mutable> + PartialReflect>(name: &'static str) -> Self {
        Self { name, access: Box::new(|world, visit| visit(&mut *world.resource_mut::<R>())) }
    }

    pub fn asset<A: Asset + PartialReflect>(name: &'static str, handle: Handle<A>) -> Self {
        let access = move |world: &mut World, visit: &mut dyn FnMut(&mut dyn PartialReflect)| {
            let mut assets = world.resource_mut::<Assets<A>>();
            visit(assets.get_mut(&handle).expect("the asset exists").into_inner());
        };
        Self { name, access: Box::new(access) }
    }

    /// Paths of all numbers, and the values to set each of them to.
    fn numbers(&self, rig: &mut Rig) -> Vec<(String, Vec<f64>)> {
        let mut numbers = Vec::new();
        (self.access)(rig.app.world_mut(), &mut |value| {
            each_number(value, "", &mut |path, number| {
                let values = match number {
                    Number::Real(_) => BAD.map(f64::from).to_vec(),
                    Number::Count(_) => BAD_COUNTS.map(f64::from).to_vec(),
                };
                numbers.push((path.to_string(), values));
            });
        });
        numbers
    }

    /// Sets the number at a path and returns its old value.
    fn set(&self, rig: &mut Rig, path: &str, new: f64) -> f64 {
        let mut old = f64::NAN;
        (self.access)(rig.app.world_mut(), &mut |value| {
            each_number(value, "", &mut |at, number| {
                if at == path {
                    old = match number {
                        Number::Real(number) => core::mem::replace(number, new as f32).into(),
                        Number::Count(number) => core::mem::replace(number, new as u32).into(),
                    };
                }
            });
        });
        old
    }
}

/// The picture of the second frame after a reset, so that temporal reuse takes part.
pub fn fresh(rig: &mut Rig) -> Picture {
    // A change is extracted in one frame and reported in the next.
    while !rig.report().ready {
        rig.frame();
    }
    rig.set(|restir| restir.reset = true);
    rig.frame();
    rig.next()
}

/// Asserts that the last counted frame is sound, and that no frame of the run raised a guard that is raised by errors of ours alone: bad
/// numbers are stopped before shaders see them.  Too bright light may raise the guard of overflows.
pub fn assert_no_errors(rig: &Rig, name: &str) {
    let report = rig.report();
    assert_eq!((report.non_finite_pixels, report.overflow_flags), (0, 0), "{name}");
    let is_bug = |raised: &str| GUARDS.iter().any(|guard| guard.is_bug && guard.name == raised);
    let bugs: Vec<_> = report.raised_guards().into_iter().filter(|&(raised, _)| is_bug(raised)).collect();
    assert_eq!(bugs, [], "{name}, or a change before it");
}

/// How many numbers [`try_all`] tries.
#[derive(Clone, Copy, PartialEq)]
pub enum Extent {
    /// Every value in every number.  The picture must be `good` again after each number.
    Full,
    /// NaN, and one other value that differs from number to number.  The picture must be `good` again after each target.
    Sample,
}

/// Sets each number of the targets to bad values.  Every picture must be finite, and with the good number the picture must be `good` again.
/// `is_skipped`: combinations on which Bevy itself fails.
pub fn try_all(
    rig: &mut Rig,
    targets: &[Target],
    good: &Picture,
    title: &str,
    extent: Extent,
    is_skipped: impl Fn(&str, &str, f64) -> bool,
) {
    for target in targets {
        let start = std::time::Instant::now();
        for (index, (path, values)) in target.numbers(rig).into_iter().enumerate() {
            let other = 1 + index % (values.len() - 1);
            let mut old = None;
            for (i, value) in values.into_iter().enumerate() {
                let is_sampled = extent == Extent::Full || i == 0 || i == other;
                if !is_sampled || is_skipped(target.name, &path, value) {
                    continue;
                }
                let name = format!("{title}: {}.{path} = {value:e}", target.name);
                let replaced = target.set(rig, &path, value);
                old.get_or_insert(replaced);
                if let Some(picture) = rig.next_if_any() {
                    assert!(picture.is_finite(), "{name}");
                }
                assert_no_errors(rig, &name);
            }
            let Some(old) = old else { continue };
            target.set(rig, &path, old);
            if extent == Extent::Full {
                assert_good_again(rig, good, &format!("{title}: {}.{path}", target.name));
            }
        }
        assert_good_again(rig, good, &format!("{title}: {}", target.name));
        eprintln!("{title}: {} took {:.1} s", target.name, start.elapsed().as_secs_f32());
    }
}

/// Asserts that the picture is `good` after bad numbers were replaced by the good ones.
fn assert_good_again(rig: &mut Rig, good: &Picture, name: &str) {
    rig.frame();
    let picture = fresh(rig);
    let differ = picture.iter().zip(good.iter()).filter(|(a, b)| a != b).count();
    assert_eq!((picture.size, differ), (good.size, 0), "{name} is good again: {differ} pixels differ");
    assert_no_errors(rig, name);
}
