//! Who may do what with jobs over a loopback port: roles, tenants and quotas.

use covis::service::engine::{AccountLimits, Resource};
use covis::wire::v1;
use tempfile::NamedTempFile;
use tonic::Code;
use v1::MapFormat;
use v1::job_spec::Spec;

use crate::common::{TestServer, check_retry, check_status, run};
use crate::job_support::{GRAPH, Jobs, compact, export, solve, twin, unsolved_map};
use crate::rpc_access::tokens_toml;

#[test]
fn tenants_see_their_own_jobs_and_roles_cover_what_a_job_does() {
    run(async {
        let file = NamedTempFile::new().unwrap();
        let tokens = tokens_toml(&[
            ("reader", "acme", "read"),
            ("writer", "acme", "write"),
            ("admin", "acme", "admin"),
            ("rival", "rival", "admin"),
        ]);
        fs_err::write(file.path(), tokens).unwrap();
        let path = file.path().to_owned();
        let server = TestServer::with(|config| config.tokens = Some(path)).await;
        let by = |who: &str| Jobs::with(&server, &format!("secret-of-{who}"));
        let create = v1::CreateMapRequest { map_id: "house".to_owned(), ..Default::default() };
        let request = crate::rpc_access::by("writer", create);
        server.maps().create_map(request).await.unwrap();

        let export = || export("house", MapFormat::Tum);
        let status = by("reader").create("a", export()).await.unwrap_err();
        check_status(&status, Code::PermissionDenied, "ROLE_TOO_LOW");
        by("writer").create("a", export()).await.unwrap();
        by("reader").success("a").await;
        let merge = || {
            Spec::MergeMaps(v1::MergeMapsRequest {
                target_map_id: "house".to_owned(),
                source_map_id: "other".to_owned(),
                ..Default::default()
            })
        };
        for spec in [merge(), compact("house", None)] {
            let status = by("writer").create("b", spec).await.unwrap_err();
            check_status(&status, Code::PermissionDenied, "ROLE_TOO_LOW");
        }
        by("admin").create("b", compact("house", None)).await.unwrap();
        by("admin").success("b").await;
        check_status(
            &by("writer").delete("a").await.unwrap_err(),
            Code::PermissionDenied,
            "ROLE_TOO_LOW",
        );

        let rival = by("rival");
        for status in [
            rival.get("a").await.unwrap_err(),
            rival.cancel("a").await.unwrap_err(),
            rival.delete("a").await.unwrap_err(),
            rival.download("a", "").await.unwrap_err(),
        ] {
            check_status(&status, Code::NotFound, "JOB_NOT_FOUND");
        }
        assert_eq!(rival.list(Default::default()).await.unwrap().jobs, []);
        let status = rival.create("a", export()).await.unwrap_err();
        check_status(&status, Code::NotFound, "MAP_NOT_FOUND");
        let upload = by("writer").upload(&[(GRAPH, twin(GRAPH))]).await.unwrap();
        let status = rival.create("a", solve(&upload)).await.unwrap_err();
        check_status(&status, Code::NotFound, "UPLOAD_NOT_FOUND");
        by("writer").create("c", solve(&upload)).await.unwrap();
        by("writer").success("c").await;
        by("admin").delete("c").await.unwrap();
    });
}

#[test]
fn quotas_refuse_what_would_pass_them() {
    run(async {
        let limits = AccountLimits::default()
            .with(Resource::PendingJobs, 2)
            .with(Resource::JobBytes, 120_000);
        let server = TestServer::with(|config| {
            config.tenant_limits = limits;
            config.test_fault = Some("hold-jobs".to_owned());
        })
        .await;
        let jobs = Jobs::of(&server);
        unsolved_map(&server, "house", 2).await;
        let spec = || export("house", MapFormat::Tum);
        jobs.create("a", spec()).await.unwrap();
        jobs.create("b", spec()).await.unwrap();
        let status = jobs.create("c", spec()).await.unwrap_err();
        check_status(&status, Code::ResourceExhausted, "TENANT_LIMIT");
        assert!(status.message().contains("tenant_max_pending_job_count"), "{status}");
        check_retry(&status);
        jobs.cancel("b").await.unwrap();
        jobs.create("c", spec()).await.unwrap();

        let large = vec![b'x'; 150_000];
        let status = jobs.upload(&[("large", large)]).await.unwrap_err();
        check_status(&status, Code::ResourceExhausted, "TENANT_LIMIT");
        assert!(status.message().contains("tenant_max_job_bytes"), "{status}");
        // What was refused holds nothing.
        jobs.upload(&[("fits", vec![b'x'; 60_000])]).await.unwrap();
        let info = v1::GetServerInfoRequest {};
        let mut client =
            v1::server_service_client::ServerServiceClient::new(server.channel.clone());
        let info = client.get_server_info(info).await.unwrap().into_inner();
        let held = |name: &str| {
            let found = info.resources.iter().find(|row| row.resource == name);
            found.unwrap_or_else(|| panic!("no {name}")).held
        };
        assert_eq!(held("pending_jobs"), 2);
        assert!((76_000..100_000).contains(&held("job_bytes")), "{}", held("job_bytes"));
    });
}
