//! Rigging at load: on other threads, if Bevy has any, and each model by each recipe once.

use std::collections::BTreeMap;
use std::sync::Arc;

use bevy::prelude::*;
use bevy::tasks::futures::check_ready;
use bevy::tasks::{AsyncComputeTaskPool, Task};
use polpo_rig::{Built, Recipe, Rig, RigError, build_rig_with};

use super::SoftBodyModel;
use super::model::ModelPrint;

/// The rigs that were made in this session, and those that are being made. They are kept until the app ends.
#[derive(Resource, Default)]
pub(super) struct Rigging(BTreeMap<(ModelPrint, String), Making>);

enum Making {
    Underway(Task<Result<Built, RigError>>),
    Done(Result<Arc<Rig>, Arc<RigError>>),
}

impl Rigging {
    /// The rig of `model` by `recipe`; `None` while it is being made. It takes about a second for 300 particles, on one thread of the `AsyncComputeTaskPool`, which without Bevy's `multi_threaded` is the main one.
    ///
    /// # Errors
    /// Those of `polpo_rig::build_rig`; the same again when it is asked for again.
    pub(super) fn rig(&mut self, model: &SoftBodyModel, recipe: &Recipe) -> Result<Option<Arc<Rig>>, Arc<RigError>> {
        let key = (model.print(), recipe.to_toml()?);
        let making = self.0.entry(key).or_insert_with(|| {
            let (mesh, recipe) = (model.mesh().clone(), recipe.clone());
            Making::Underway(AsyncComputeTaskPool::get().spawn(async move { build_rig_with(&mesh, &recipe, &mut |_| {}) }))
        });
        if let Making::Underway(task) = making {
            let Some(built) = check_ready(task) else {
                return Ok(None);
            };
            *making = Making::Done(match built {
                Ok(Built { rig, notes }) => {
                    notes.iter().for_each(|note| tracing::warn!("{}: {note}", model.mesh().name));
                    Ok(Arc::new(rig))
                }
                Err(error) => Err(Arc::new(error)),
            });
        }
        match making {
            Making::Done(result) => result.clone().map(Some),
            Making::Underway(_) => Ok(None),
        }
    }
}
