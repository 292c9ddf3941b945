//! Stiffness particle by particle and edge by edge, where one number for the body will not do.

use bevy::prelude::*;
use polpo_solver::{Share, Shares, Stiffness};

/// A stiffness for each group, instead of [`ShapeMatching`](crate::ShapeMatching)'s one for all.
#[derive(Component, Debug, Clone, Default)]
pub struct ParticleStiffness(pub(crate) Each);

impl ParticleStiffness {
    /// One a particle, for the group it is the middle of, in the rig's order. Particles beyond the end have none.
    pub fn new(stiffness: Vec<Stiffness>) -> Self {
        Self(Each { stiffness, ..Each::default() })
    }

    /// What it was made from.
    pub fn get(&self) -> &[Stiffness] {
        &self.0.stiffness
    }

    /// To change it.
    pub fn get_mut(&mut self) -> &mut Vec<Stiffness> {
        self.0.dt = 0.0;
        &mut self.0.stiffness
    }
}

/// A stiffness for each edge, instead of the one for all in [`DistanceConstraints`](crate::DistanceConstraints) and [`Torsion`](crate::Torsion).
#[derive(Component, Debug, Clone, Default)]
pub struct EdgeStiffness {
    pub(crate) tension: Option<Each>,
    pub(crate) compression: Option<Each>,
    pub(crate) torsion: Option<Each>,
}

impl EdgeStiffness {
    /// One an edge, in the rig's order; an edge beyond the end of a list has none. Where there is no list, the component's own number counts.
    pub fn new(tension: Option<Vec<Stiffness>>, compression: Option<Vec<Stiffness>>, torsion: Option<Vec<Stiffness>>) -> Self {
        let each = |list: Option<Vec<Stiffness>>| list.map(|stiffness| Each { stiffness, ..Each::default() });
        Self { tension: each(tension), compression: each(compression), torsion: each(torsion) }
    }
}

/// A list of stiffnesses and what they come to in the running substep.
#[derive(Debug, Clone, Default)]
pub(crate) struct Each {
    stiffness: Vec<Stiffness>,
    shares: Vec<Share>,
    /// The substep for which `shares` were worked out \[s\]; 0 if they were not.
    dt: f32,
}

/// The shares of `each` if there is one, else of `one`, in a substep of `dt` \[s\].
pub(crate) fn shares_of(each: Option<&mut Each>, one: Stiffness, dt: f32) -> Shares<'_> {
    match each {
        Some(each) => {
            if each.dt != dt {
                each.shares.clear();
                each.shares.extend(each.stiffness.iter().map(|s| s.share(dt)));
                each.dt = dt;
            }
            Shares::Each(&each.shares)
        }
        None => Shares::One(one.share(dt)),
    }
}
