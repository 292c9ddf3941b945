//! Edits: what an artist changed by hand, told by places so that it holds for a mesh that was changed a little.

use serde::{Deserialize, Serialize};

use crate::RigError;
use crate::recipe::check;

/// One change by hand. A place \[m\] means the particle whose centre is nearest.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase", deny_unknown_fields)]
pub enum Edit {
    /// Ties the particles at two places by an edge.
    Connect([[f32; 3]; 2]),
    /// Takes away the edge between the particles at two places, unless the body would fall apart.
    Disconnect([[f32; 3]; 2]),
    /// Moves the particle at the first place to the second. Its shape and the skin weights are made for where it is then.
    Move([[f32; 3]; 2]),
    /// Adds a particle at a place in the body.
    Add([f32; 3]),
    /// Takes away the particle at a place.
    Remove([f32; 3]),
}

impl Edit {
    /// The places that it tells.
    pub fn places(&self) -> Vec<[f32; 3]> {
        match *self {
            Edit::Connect(places) | Edit::Disconnect(places) | Edit::Move(places) => places.to_vec(),
            Edit::Add(place) | Edit::Remove(place) => vec![place],
        }
    }

    pub(crate) fn validate(&self) -> Result<(), RigError> {
        let worst = self.places().into_iter().flatten().find(|x| !x.is_finite());
        worst.map_or(Ok(()), |x| check("edit", x.into(), false, "finite"))
    }
}
