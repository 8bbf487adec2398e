//! Users, passwords and TLS.

use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::process::Command;

use bson::{Document, doc};
use libtest_mimic::Failed;
use mongodb::error::ErrorKind;
use mongodb::sync::Client;

use super::wire::Wire;
use super::{Case, Served};

pub(super) const CASES: &[(&str, Case)] = &[
    ("who_has_no_password_is_let_do_nothing", passwords),
    ("other_ways_to_log_in_are_refused", downgrades),
    ("nothing_but_this_machine_is_served_without_users_and_tls", reach),
    ("what_is_sent_is_encrypted", encrypted),
];

fn users(folder: &Path) -> Result<(), Failed> {
    let path = folder.join("users");
    std::fs::write(&path, "# robots\nr2:pencil\n")?;
    Ok(std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o600))?)
}

fn count(uri: &str) -> Result<u64, mongodb::error::Error> {
    Client::with_uri_str(uri)?.database("a").collection::<Document>("c").count_documents(doc! {}).run()
}

fn passwords() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    users(folder.path())?;
    let served = Served::start(folder.path(), &["--users", "users"])?;
    let host = served.address().to_owned();
    assert_eq!(count(&format!("mongodb://r2:pencil@{host}/"))?, 0);
    for (wrong, source) in [("r2:pencils", "admin"), ("c3:pencil", "admin"), ("r2:pencil", "a")] {
        let uri = format!("mongodb://{wrong}@{host}/?authSource={source}&serverSelectionTimeoutMS=2000");
        let error = count(&uri).err().ok_or("let in")?;
        assert!(matches!(*error.kind, ErrorKind::Authentication { .. }), "{error}");
    }
    let mut wire = Wire::connect(&host)?;
    for (command, is_open) in [
        (doc! { "ping": 1 }, true),
        (doc! { "hello": 1 }, true),
        (doc! { "buildInfo": 1 }, true),
        (doc! { "find": "c" }, false),
        (doc! { "insert": "c", "documents": [{}] }, false),
        (doc! { "listDatabases": 1 }, false),
        (doc! { "endSessions": [] }, false),
        (doc! { "getMore": 1_i64, "collection": "c" }, false),
    ] {
        let mut command = command;
        command.insert("$db", "admin");
        let answer = wire.run(&command)?;
        let expected = if is_open { None } else { Some(13) };
        assert_eq!(answer.get_i32("code").ok(), expected, "{command}: {answer}");
    }
    std::fs::set_permissions(folder.path().join("users"), std::fs::Permissions::from_mode(0o644))?;
    drop(served);
    assert!(Served::start(folder.path(), &["--users", "users"]).is_err());
    Ok(())
}

fn downgrades() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    users(folder.path())?;
    let served = Served::start(folder.path(), &["--users", "users"])?;
    let mut wire = Wire::connect(served.address())?;
    let payload =
        |text: &str| bson::Binary { subtype: bson::spec::BinarySubtype::Generic, bytes: text.as_bytes().to_vec() };
    for mechanism in ["SCRAM-SHA-1", "PLAIN", "MONGODB-X509"] {
        let start =
            doc! { "saslStart": 1, "mechanism": mechanism, "payload": payload("n,,n=r2,r=abc"), "$db": "admin" };
        assert_eq!(wire.run(&start)?.get_i32("code")?, 334);
    }
    let start =
        doc! { "saslStart": 1, "mechanism": "SCRAM-SHA-256", "payload": payload("n,,n=r2,r=abc"), "$db": "admin" };
    assert!(!wire.run(&start)?.get_bool("done")?);
    let go_on =
        doc! { "saslContinue": 1, "conversationId": 1, "payload": payload("c=biws,r=abc,p=AAAA"), "$db": "admin" };
    assert_eq!(wire.run(&go_on)?.get_i32("code")?, 18);
    // A login that failed is over, whatever is sent next.
    assert_eq!(wire.run(&go_on)?.get_i32("code")?, 17);
    let hello = wire.run(&doc! { "hello": 1, "saslSupportedMechs": "admin.nobody", "$db": "admin" })?;
    assert_eq!(hello.get_array("saslSupportedMechs")?.len(), 1);
    Ok(())
}

fn reach() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    users(folder.path())?;
    for options in
        [&["--listen", "0.0.0.0:0"][..], &["--listen", "0.0.0.0:0", "--users", "users"], &["--listen", "[::]:0"]]
    {
        let output = Command::new(env!("CARGO_BIN_EXE_rmem"))
            .args(["--memory", "file:robot.rmem", "serve"])
            .args(options)
            .current_dir(folder.path())
            .output()?;
        assert_eq!(output.status.code(), Some(2), "{options:?}");
    }
    assert!(!folder.path().join("robot.rmem").exists());
    Ok(())
}

fn encrypted() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    users(folder.path())?;
    let tls = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/tls");
    let (certificate, key) = (tls.join("cert.pem").display().to_string(), tls.join("key.pem").display().to_string());
    let authority = tls.join("ca.pem").display().to_string();
    let options = ["--listen", "0.0.0.0:0", "--users", "users", "--tls-cert", &certificate, "--tls-key", &key];
    let served = Served::start_as(folder.path(), &options)?;
    let port = served.address().rsplit(':').next().ok_or("no port")?.to_owned();
    assert!(served.uri.ends_with("?tls=true"), "{}", served.uri);
    let uri =
        format!("mongodb://r2:pencil@localhost:{port}/?tls=true&tlsCAFile={authority}&serverSelectionTimeoutMS=5000");
    let found = Client::with_uri_str(uri)?.database("a").collection::<Document>("c");
    found.insert_many((0..500).map(|n| doc! { "_id": n, "pad": "x".repeat(1000) })).run()?;
    let all: Vec<Document> = found.find(doc! {}).batch_size(50).run()?.collect::<Result<_, _>>()?;
    assert_eq!(all.len(), 500);
    // A client without encryption gets no answer.
    let plain = format!("mongodb://r2:pencil@localhost:{port}/?serverSelectionTimeoutMS=1000");
    assert!(count(&plain).is_err());
    assert!(Wire::connect(&format!("127.0.0.1:{port}"))?.run(&doc! { "ping": 1, "$db": "a" }).is_err());
    Ok(())
}
