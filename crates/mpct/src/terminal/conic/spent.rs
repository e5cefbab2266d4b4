//! Is a row or an ellipsoid spent at a step? Answered with a proof, with a point that refutes it, or not at all.

use super::fan::{self, Asked, Bounded, Direction};
use super::{ConicSystem, Set, Support, add_product, dot, norm};
use crate::linalg::Dense;
use std::sync::atomic::{AtomicUsize, Ordering};

/// A support up to 1 + this counts as at most 1, as in the search over polytopes.
pub(super) const SPENT_TOLERANCE: f64 = 1e-9;
/// Supports that a fan may ask for besides the axes.
const BUDGET: usize = 240;
/// Steps uphill from the best point that the axes found.
const UPHILL: usize = 20;
/// Uphill steps end when the norm grows less than this.
const LEVEL: f64 = 1e-9;

/// The answer.
pub(super) enum Verdict {
    /// Implied by the steps before.
    Spent(Reason),
    /// A point of the set breaks it; its value there.
    NotSpent(f64),
    /// Neither was shown; the smallest upper bound that was.
    Undecided(f64),
}

/// What shows that an item is spent.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Reason {
    /// One support.
    Row,
    /// Supports of the vector in these directions; of its e part alone when `split`.
    Norm {
        split: bool,
        directions: Vec<Direction>,
    },
}

/// A question: an item at a step, against the constraints of steps 0, …, `known` − 1.
#[derive(Clone, Copy)]
pub(super) struct Question<'a> {
    pub(super) item: usize,
    pub(super) step: usize,
    pub(super) known: usize,
    /// First spent steps that are known, by item.
    pub(super) spent: &'a [usize],
}

impl ConicSystem {
    pub(super) fn decide(&self, question: Question<'_>, programs: &AtomicUsize) -> Verdict {
        if question.known < self.bounded_from {
            return Verdict::Undecided(f64::INFINITY);
        }
        let set = || self.set(question.known, question.spent);
        match question.item.checked_sub(self.rows) {
            None => self.decide_row(question, set, programs),
            Some(k) => self.decide_norm(k, question.step, set, programs),
        }
    }

    fn decide_row(
        &self,
        question: Question<'_>,
        set: impl FnOnce() -> Set,
        programs: &AtomicUsize,
    ) -> Verdict {
        let form = self.form(question.item, Some(question.step));
        if form.iter().map(|v| v.abs()).sum::<f64>() <= 1.0 {
            return Verdict::Spent(Reason::Row);
        }
        programs.fetch_add(1, Ordering::Relaxed);
        let Some(Support { point, upper, .. }) = set().support(&form) else {
            return Verdict::Undecided(f64::INFINITY);
        };
        let value = dot(&form, &point);
        if upper <= 1.0 + SPENT_TOLERANCE {
            Verdict::Spent(Reason::Row)
        } else if value > 1.0 + SPENT_TOLERANCE {
            Verdict::NotSpent(value)
        } else {
            Verdict::Undecided(upper)
        }
    }

    fn decide_norm(
        &self,
        k: usize,
        step: usize,
        set: impl FnOnce() -> Set,
        programs: &AtomicUsize,
    ) -> Verdict {
        let (first, q) = self.norms[k];
        let h = &self.offset[first..first + q];
        let whole: Vec<Vec<f64>> = (first..first + q)
            .map(|f| self.form(f, Some(step)))
            .collect();
        let moving: Vec<Vec<f64>> = (first..first + q)
            .map(|f| self.transient(f, step))
            .collect();
        let axes = || -> Vec<Direction> {
            (0..q)
                .flat_map(|k| [fan::axis(q, k, 1), fan::axis(q, k, -1)])
                .collect()
        };
        let because = |split, directions| Verdict::Spent(Reason::Norm { split, directions });
        // Over the box alone: nothing else is needed where the e part has faded.
        let in_box = |form: &[f64]| form.iter().map(|v| v.abs()).sum::<f64>();
        let room = self.room(h);
        let boxed: Vec<[f64; 2]> = whole
            .iter()
            .zip(h)
            .map(|(f, h)| [in_box(f) + h, in_box(f) - h])
            .collect();
        if fan::corner(&boxed) <= 1.0 {
            return because(false, axes());
        }
        if moving.iter().map(|f| in_box(f)).fold(0.0_f64, f64::hypot) <= room {
            return because(true, axes());
        }
        let mut asker = Asker {
            set: set(),
            map: Dense::from_fn(q, self.dimension(), |i, j| whole[i][j]),
            offset: h,
            longest: vec![0.0; q],
            norm: 0.0,
            programs,
        };
        let sides: Vec<[f64; 2]> = asker
            .axes(&whole, self.symmetric)
            .iter()
            .zip(h)
            .map(|(s, h)| [s[0] + h, s[1] - h])
            .collect();
        let corner = fan::corner(&sides);
        if corner <= 1.0 + SPENT_TOLERANCE {
            return because(false, axes());
        }
        asker.go_uphill(&whole);
        if asker.refutes() {
            return Verdict::NotSpent(asker.norm);
        }
        // The e part alone, against the room that θ ∈ λΘ leaves.
        let split = fan::corner(&asker.axes(&moving, self.symmetric));
        if split <= room {
            return because(true, axes());
        }
        let found = fan::is_within(&sides, 1.0 + SPENT_TOLERANCE, BUDGET, |d| {
            let real: Vec<f64> = d.iter().map(|v| *v as f64).collect();
            let upper = asker.support(&whole, &real);
            if asker.refutes() {
                Asked::Stop
            } else {
                Asked::AtMost(upper + dot(&real, h))
            }
        });
        match found {
            Some(Bounded::Yes(directions)) => because(false, directions),
            Some(Bounded::No(bound)) => Verdict::Undecided(bound.min(1.0 - room + split)),
            None => Verdict::NotSpent(asker.norm),
        }
    }

    /// What is left for ‖F A_Kᵗ e‖ when θ ∈ λΘ: ‖Wθ + h‖ ≤ ‖Wθ + λh‖ + (1 − λ)‖h‖ ≤ λ + (1 − λ)‖h‖.
    fn room(&self, h: &[f64]) -> f64 {
        let taken = if self.parameters > 0 {
            self.scaling
        } else {
            0.0
        };
        (1.0 - taken) * (1.0 - norm(h))
    }
}

/// Asks a set for supports of a vector, and remembers the longest vector that a point of the set gave.
struct Asker<'a> {
    set: Set,
    /// The vector at z is this times z, plus the offset.
    map: Dense,
    offset: &'a [f64],
    longest: Vec<f64>,
    norm: f64,
    programs: &'a AtomicUsize,
}

impl Asker<'_> {
    /// An upper bound of max Σ d_k form_k; +∞ without an answer of the solver.
    fn support(&mut self, forms: &[Vec<f64>], d: &[f64]) -> f64 {
        self.programs.fetch_add(1, Ordering::Relaxed);
        let Some(support) = self.set.support(&combination(forms, d)) else {
            return f64::INFINITY;
        };
        let mut v = self.offset.to_vec();
        add_product(&mut v, &self.map, &support.point, 1.0);
        if norm(&v) > self.norm {
            self.norm = norm(&v);
            self.longest = v;
        }
        support.upper
    }

    /// Supports of the forms along ±e_k.
    fn axes(&mut self, forms: &[Vec<f64>], symmetric: bool) -> Vec<[f64; 2]> {
        let q = forms.len();
        let unit = |k: usize, sign: f64| -> Vec<f64> {
            (0..q).map(|i| if i == k { sign } else { 0.0 }).collect()
        };
        (0..q)
            .map(|k| {
                let above = self.support(forms, &unit(k, 1.0));
                let below = if symmetric {
                    above
                } else {
                    self.support(forms, &unit(k, -1.0))
                };
                [above, below]
            })
            .collect()
    }

    /// Whether a point of the set breaks the ellipsoid.
    fn refutes(&self) -> bool {
        self.norm > 1.0 + SPENT_TOLERANCE
    }

    /// The support in the direction of a vector is at least its norm, and its point gives a vector at least as long.
    fn go_uphill(&mut self, forms: &[Vec<f64>]) {
        for _ in 0..UPHILL {
            let before = self.norm;
            if self.refutes() || before == 0.0 {
                return;
            }
            let d: Vec<f64> = self.longest.iter().map(|v| v / before).collect();
            self.support(forms, &d);
            if !(self.norm > before + LEVEL) {
                return;
            }
        }
    }
}

/// Σ d_k form_k.
pub(super) fn combination(forms: &[Vec<f64>], d: &[f64]) -> Vec<f64> {
    let mut sum = vec![0.0; forms.first().map_or(0, Vec::len)];
    for (form, d) in forms.iter().zip(d) {
        sum.iter_mut().zip(form).for_each(|(s, f)| *s += d * f);
    }
    sum
}
