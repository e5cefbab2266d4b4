//! Section 4 in its short form, against stored numbers.

use mpct::analysis::reproduce::{Extent, reproduce};

#[test]
fn the_short_form_gives_the_stored_numbers() {
    let r = reproduce(Extent::Short, &|_| {}).expect("section 4");
    for line in &r.table_1 {
        assert_eq!(line.terminal_horizon, line.printed_horizon, "{line:?}");
    }
    assert_eq!(
        r.table_1.iter().filter(|l| l.plant == "academic").count(),
        7
    );
    assert!(r.table_1.iter().filter(|l| l.plant == "drone").count() >= 2);
    // The cost rises as λ falls.
    for pair in r.table_1.windows(2) {
        if pair[0].plant == "academic" && pair[1].plant == "academic" {
            assert!(
                pair[1].cumulative_cost > pair[0].cumulative_cost,
                "{pair:?}"
            );
        }
    }
    let three = &r.table_2[0];
    assert_eq!(
        (three.carts, three.terminal_horizon, three.variables),
        (3, 13, 18)
    );
    assert!(three.explicit_rows.expect("explicit") <= three.implicit_rows);
    let (one, two) = (&r.figure_1, &r.figure_2);
    for v in &one.regulation_set.vertices {
        assert!(one.tracking_set.contains(v.map(|c| 0.999 * c)), "{v:?}");
    }
    for v in &one.tracking_set.vertices {
        assert!(one.domain.contains(v.map(|c| 0.999 * c)), "{v:?}");
    }
    for p in &one.run {
        assert!(
            one.domain
                .contains([0.999_999 * p.state[0], 0.999_999 * p.state[1]]),
            "{p:?}"
        );
    }
    assert!((two.d - 2.2253).abs() < 1e-4);
    let stored = [
        (one.tracking_set.area(), TRACKING_SET),
        (one.regulation_set.area(), REGULATION_SET),
        (one.domain.area(), DOMAIN),
        (two.region.area(), REGION),
    ];
    for (area, expected) in stored {
        assert!((area - expected).abs() < 1e-3 * expected, "{stored:?}");
    }
    assert_eq!(r.figure_3.run.len(), 120);
}

/// Areas, checked against a grid of feasibility problems in the tests of the domain and the region.
const TRACKING_SET: f64 = 32.0;
const REGULATION_SET: f64 = 29.6737;
const DOMAIN: f64 = 32.0;
const REGION: f64 = 25.9687;
