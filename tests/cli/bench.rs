//! bench.

use crate::lab::Lab;

#[test]
fn bench_measures_every_kind_of_work_and_draws_it() {
    let lab = Lab::new();
    let report = lab.rmem(&["bench", "--documents", "20", "--documents", "10", "--rounds", "2", "--plot", "plots"]);
    let report = report.success();
    assert_eq!(report.lines().count(), 12, "{report}");
    assert!(report.starts_with("{\"documents\":10,\"work\":\"insert\",\"embedded_us\":"), "{report}");
    assert!(lab.read("plots/memory.svg").contains("indexed update"));
    lab.rmem(&["bench", "--against", "file:x.rmem"]).exits(2);
}
