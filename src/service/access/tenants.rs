//! Callers and their tenants. A tenant sees only its own maps, under names that it chooses.
//!
//! The engine knows a map as `tenant.name`; neither part can hold a dot, and the maps of the default
//! tenant have the bare name. The tenant stays inside the server: it is in no answer and no error.

use std::sync::Arc;

use super::Role;
use super::rights::Proof;
use crate::service::engine::{SEPARATOR, tenant_of};
use crate::service::error::ServiceError;

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

#[cfg(test)]
mod tests {
    use super::Caller;
    use crate::service::access::Role;
    use crate::service::names::shown;

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
}
