//! Callers and their tenants. A tenant sees only its own maps, under names of its own choice.
//!
//! The engine knows a map as `tenant.name`; neither part can hold a dot, and the maps of the default
//! tenant have the bare name. The tenant stays inside the server: it is in no answer and no error.

use std::sync::Arc;

use super::Role;
use super::rights::Proof;
use crate::service::engine::{EngineError, SEPARATOR, tenant_of};
use crate::service::error::ServiceError;
use crate::store::StoreError;

/// Who makes a call.
#[derive(Clone, Debug)]
pub(in crate::service) struct Caller {
    token: Arc<str>,
    tenant: Arc<str>,
    role: Role,
    /// The role that its call needs.
    needed: Role,
    proof: Proof,
}

impl Caller {
    /// The owner of the token called `token`; the default tenant's name is empty.
    pub(super) fn new(token: &str, tenant: &str, role: Role) -> Self {
        let (token, tenant) = (token.into(), tenant.into());
        Self { token, tenant, role, needed: Role::Read, proof: Proof::Nothing }
    }

    /// The same caller with this proof.
    pub(super) fn showing(self, proof: Proof) -> Self {
        Self { proof, ..self }
    }

    /// The same caller in a call that needs the role `needed`.
    pub(super) fn calling(self, needed: Role) -> Self {
        Self { needed, ..self }
    }

    /// The caller of a server without tokens.
    pub(super) fn everybody() -> Self {
        Self::new("", "", Role::Admin)
    }

    /// Whoever acts for a tenant in a job that was created before.
    pub(in crate::service) fn of_tenant(tenant: &str) -> Self {
        Self::new("", tenant, Role::Admin)
    }

    /// Refuses what takes a higher role than the caller's.
    ///
    /// # Errors
    /// [`ServiceError::RoleTooLow`].
    pub(in crate::service) fn require(&self, needed: Role) -> Result<(), ServiceError> {
        let is_covered = self.role >= needed;
        is_covered.then_some(()).ok_or(ServiceError::RoleTooLow { needed: needed.name() })
    }

    /// The name of its token.
    pub(super) fn token(&self) -> &str {
        &self.token
    }

    /// Its tenant.
    pub(in crate::service) fn tenant(&self) -> &str {
        &self.tenant
    }

    /// The role that its call needs.
    pub(super) fn needed(&self) -> Role {
        self.needed
    }

    /// The proof that it presented.
    pub(super) fn proof(&self) -> &Proof {
        &self.proof
    }

    /// The engine's name of this caller's map.
    pub(in crate::service) fn engine_name(&self, map_id: &str) -> String {
        match &*self.tenant {
            "" => map_id.to_owned(),
            tenant => format!("{tenant}{SEPARATOR}{map_id}"),
        }
    }

    /// Whether a map is of this caller's tenant, by the engine's name of it.
    pub(in crate::service) fn owns(&self, engine_name: &str) -> bool {
        tenant_of(engine_name) == &*self.tenant
    }
}

/// The name of a map as its tenant knows it.
pub(in crate::service) fn shown(engine_name: &str) -> &str {
    engine_name.split_once(SEPARATOR).map_or(engine_name, |(_, name)| name)
}

/// The error as the map's tenant may read it.
pub(in crate::service) fn hide_tenant(mut error: EngineError) -> EngineError {
    for map in maps_of(&mut error).into_iter().flatten() {
        *map = shown(map).to_owned();
    }
    error
}

/// The maps that an error names.
pub(in crate::service) fn maps_of(error: &mut EngineError) -> [Option<&mut String>; 2] {
    let map = match error {
        EngineError::MergedAway { map, into: other }
        | EngineError::NotMerged { map, source_map: other } => {
            return [Some(map), Some(other)];
        }
        EngineError::MapNotFound { map }
        | EngineError::MapExists { map }
        | EngineError::Poisoned { map }
        | EngineError::Refused { map, .. }
        | EngineError::Frozen { map }
        | EngineError::AnchorInUse { map }
        | EngineError::NoPlaceRecognition { map }
        | EngineError::Moving { map }
        | EngineError::NotAligned { map, .. }
        | EngineError::CannotMerge { map, .. }
        | EngineError::RevisionMismatch { map, .. }
        | EngineError::EpochFenced { map, .. }
        | EngineError::OptimizationRunning { map }
        | EngineError::MapLimit { map, .. }
        | EngineError::RevisionAhead { map, .. }
        | EngineError::NothingToSolve { map }
        | EngineError::Cancelled { map }
        | EngineError::Journal { map, .. }
        | EngineError::Store(
            StoreError::UnknownMap { map }
            | StoreError::MapExists { map }
            | StoreError::OwnedElsewhere { map, .. }
            | StoreError::Fenced { map, .. }
            | StoreError::SequenceMismatch { map, .. }
            | StoreError::NotReadable { map, .. }
            | StoreError::Unfit { map, .. }
            | StoreError::Truncated { map, .. }
            | StoreError::NoSnapshot { map, .. }
            | StoreError::Unavailable { map, .. }
            | StoreError::Failed { map, .. }
            | StoreError::Later { map, .. }
            | StoreError::Ambiguous { map, .. }
            | StoreError::Stopped { map, .. }
            | StoreError::Damaged { map, .. },
        ) => Some(map),
        EngineError::TooLarge { .. } | EngineError::ServerLimit { .. } => None,
        EngineError::Store(
            StoreError::File { .. }
            | StoreError::Content { .. }
            | StoreError::InUse { .. }
            | StoreError::NotEmpty { .. },
        )
        | EngineError::Solve(_)
        | EngineError::NoSuchKeyframe { .. }
        | EngineError::ShuttingDown
        | EngineError::TenantLimit { .. }
        | EngineError::Threads { .. }
        | EngineError::Bug { .. } => None,
    };
    [map, None]
}

#[cfg(test)]
mod tests {
    use super::{Caller, hide_tenant, shown};
    use crate::service::access::Role;
    use crate::service::engine::EngineError;

    #[test]
    fn tenants_share_no_names() {
        let check = |tenant: &str, name: &str, engine_name: &str| {
            let caller = Caller::new("t", tenant, Role::Read);
            assert_eq!(caller.engine_name(name), engine_name);
            assert_eq!(shown(engine_name), name);
            assert!(caller.owns(engine_name));
            assert!(!caller.owns(&format!("other.{name}")));
        };
        check("", "house", "house");
        check("acme", "house", "acme.house");
        assert!(!Caller::everybody().owns("acme.house"));
        assert!(!Caller::new("t", "acme", Role::Admin).owns("house"));
    }

    #[test]
    fn an_error_does_not_tell_the_tenant() {
        let error = hide_tenant(EngineError::MapNotFound { map: "acme.house".to_owned() });
        assert_eq!(error.to_string(), "map \"house\" does not exist");
    }
}
