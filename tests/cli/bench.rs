//! bench.

use crate::lab::Lab;

#[test]
fn bench_measures_every_kind_of_work_and_draws_it() {
    let lab = Lab::new();
    let report = lab.rmem(&["bench", "--documents", "20", "--documents", "10", "--rounds", "2", "--plot", "plots"]);
    let report = report.success();
    assert_eq!(report.lines().count(), 24, "{report}");
    assert!(report.starts_with("{\"documents\":10,\"work\":\"insert\",\"embedded_us\":"), "{report}");
    assert!(report.contains("\"work\":\"indexed find misplaced ($where)\""), "{report}");
    for figure in ["plots/figure-6-2.svg", "plots/figure-6-3.svg"] {
        assert!(lab.read(figure).contains("find misplaced ($where)"), "{figure}");
    }
    lab.rmem(&["bench", "--against", "file:x.rmem"]).exits(2);
}
