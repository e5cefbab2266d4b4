//! The order of variables, states, set-point and rows in which a program of many subsystems is banded.
//!
//! Nodes are the inputs (with all their stages) and the parameters of θ; two are neighbours when a row or the cost couples them
//! noticeably. The order is that of Cuthill and McKee (Proceedings of the 24th ACM National Conference, 1969), reversed
//! or not makes no difference here: breadth first, from a node at the rim.

use super::local_program::LocalProgram;
use crate::matrix::SparseMatrix;
use std::collections::VecDeque;

/// Entries smaller than this, relative to the largest of their row in units of the cost, do not decide about the order: they
/// reach further than what matters.
const NOTICED: f64 = 1e-2;

/// Places in the banded order.
pub(super) struct Order {
    /// The variable at each place.
    pub(super) variables: Vec<u32>,
    /// The state at each place.
    pub(super) states: Vec<u32>,
    /// The set-point entry (state, then input) at each place.
    pub(super) set_point: Vec<u32>,
    /// The pair at each place.
    pub(super) pairs: Vec<u32>,
}

/// The order for a program with `inputs` m and `stages` N.
pub(super) fn order(program: &LocalProgram, inputs: usize, stages: usize) -> Order {
    let size = program.hessian.rows();
    let theta = stages * inputs;
    let node = |v: usize| {
        if v < theta {
            v % inputs
        } else {
            inputs + v - theta
        }
    };
    let nodes = inputs + size - theta;
    let neighbours = neighbours(program, nodes, &node);
    let mut variables = Vec::with_capacity(size);
    for k in breadth_first(&neighbours) {
        if k < inputs {
            variables.extend((0..stages).map(|stage| (stage * inputs + k) as u32));
        } else {
            variables.push((theta + k - inputs) as u32);
        }
    }
    let place = inverse(&variables);

    // Pairs by the first variable they touch; a state and a set-point entry stand where the rows that speak most of them do.
    let first = |i: usize| {
        program
            .rows
            .row(i)
            .map(|(v, _)| place[v])
            .min()
            .unwrap_or(size as u32)
    };
    let mut pairs: Vec<(u32, u32)> = (0..program.rows.rows())
        .map(|i| (first(i), i as u32))
        .collect();
    pairs.sort_unstable();
    let states = by_place(
        &[(&program.state_rows, &|i| middle(&program.rows, &place, i))],
        program.state_rows.cols(),
    );
    let n = program.state_rows.cols();
    let count = program.from_set_point.cols();
    let state_place = inverse(&states);
    // States of the set-point in the order of the states, inputs among them by their first stage.
    let mut set_point: Vec<(f64, u32)> = (0..count)
        .map(|j| {
            let at = if j < n {
                f64::from(state_place[j]) / n.max(1) as f64
            } else {
                f64::from(place[(j - n) % inputs.max(1)]) / size.max(1) as f64
            };
            (at, j as u32)
        })
        .collect();
    set_point.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    Order {
        variables,
        states,
        set_point: set_point.into_iter().map(|e| e.1).collect(),
        pairs: pairs.into_iter().map(|e| e.1).collect(),
    }
}

/// The place of each thing, from the thing at each place.
pub(super) fn inverse(order: &[u32]) -> Vec<u32> {
    let mut place = vec![0; order.len()];
    for (k, &thing) in order.iter().enumerate() {
        place[thing as usize] = k as u32;
    }
    place
}

fn neighbours(
    program: &LocalProgram,
    nodes: usize,
    node: &dyn Fn(usize) -> usize,
) -> Vec<Vec<usize>> {
    let unit: Vec<f64> = (0..program.hessian.rows())
        .map(|v| program.hessian.get(v, v).sqrt())
        .collect();
    let mut neighbours = vec![Vec::new(); nodes];
    let mut couple = |together: &mut Vec<usize>| {
        together.sort_unstable();
        together.dedup();
        for &a in together.iter() {
            neighbours[a].extend(together.iter().copied().filter(|&b| b != a));
        }
    };
    for i in 0..program.rows.rows() {
        let size = |v: usize, g: f64| g.abs() / unit[v];
        let largest = program
            .rows
            .row(i)
            .fold(0.0_f64, |a, (v, g)| a.max(size(v, g)));
        let mut together: Vec<usize> = program
            .rows
            .row(i)
            .filter(|&(v, g)| size(v, g) > NOTICED * largest)
            .map(|(v, _)| node(v))
            .collect();
        couple(&mut together);
    }
    for (i, j, h) in program.hessian.entries() {
        if h.abs() > NOTICED * unit[i] * unit[j] {
            couple(&mut vec![node(i), node(j)]);
        }
    }
    for list in &mut neighbours {
        list.sort_unstable();
        list.dedup();
    }
    neighbours
}

/// All nodes, component by component, breadth first from a node at the rim.
fn breadth_first(neighbours: &[Vec<usize>]) -> Vec<usize> {
    let mut order = Vec::with_capacity(neighbours.len());
    let mut seen = vec![false; neighbours.len()];
    while let Some(start) = (0..neighbours.len())
        .filter(|&k| !seen[k])
        .min_by_key(|&k| neighbours[k].len())
    {
        // The last node of a search is at the rim; twice, to come from the other side.
        let mut rim = start;
        for _ in 0..2 {
            let mut reached = seen.clone();
            rim = *walk(neighbours, rim, &mut reached).last().unwrap_or(&rim);
        }
        order.extend(walk(neighbours, rim, &mut seen));
    }
    order
}

fn walk(neighbours: &[Vec<usize>], start: usize, seen: &mut [bool]) -> Vec<usize> {
    let mut queue = VecDeque::from([start]);
    let mut order = Vec::new();
    seen[start] = true;
    while let Some(k) = queue.pop_front() {
        order.push(k);
        let mut next: Vec<usize> = neighbours[k]
            .iter()
            .copied()
            .filter(|&j| !seen[j])
            .collect();
        next.sort_by_key(|&j| (neighbours[j].len(), j));
        for j in next {
            if !seen[j] {
                seen[j] = true;
                queue.push_back(j);
            }
        }
    }
    order
}

/// The mean place of what a row touches, weighted by squares.
fn middle(rows: &SparseMatrix, place: &[u32], i: usize) -> f64 {
    let (mut sum, mut weight) = (0.0, 0.0);
    for (v, g) in rows.row(i) {
        sum += g * g * f64::from(place[v]);
        weight += g * g;
    }
    if weight > 0.0 { sum / weight } else { 0.0 }
}

/// A matrix and the place of each of its rows.
type Placed<'a> = (&'a SparseMatrix, &'a dyn Fn(usize) -> f64);

/// Columns ordered by the place of the row in which they weigh most.
fn by_place(matrices: &[Placed<'_>], columns: usize) -> Vec<u32> {
    let mut strongest = vec![(0.0_f64, 0.0_f64); columns];
    for (matrix, place) in matrices {
        for i in 0..matrix.rows() {
            let largest = matrix.row(i).fold(0.0_f64, |a, (_, v)| a.max(v.abs()));
            let mut at = None;
            for (j, v) in matrix.row(i) {
                let share = v.abs() / largest;
                if share > strongest[j].0 {
                    let at = *at.get_or_insert_with(|| place(i));
                    strongest[j] = (share, at);
                }
            }
        }
    }
    let mut order: Vec<u32> = (0..columns as u32).collect();
    order.sort_by(|&a, &b| {
        strongest[a as usize]
            .1
            .total_cmp(&strongest[b as usize].1)
            .then(a.cmp(&b))
    });
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shuffled_chain_is_put_in_line() {
        // 0 – 3 – 1 – 4 – 2
        let mut neighbours = vec![Vec::new(); 5];
        for (a, b) in [(0, 3), (3, 1), (1, 4), (4, 2)] {
            neighbours[a].push(b);
            neighbours[b].push(a);
        }
        let order = breadth_first(&neighbours);
        assert!(
            order == [0, 3, 1, 4, 2] || order == [2, 4, 1, 3, 0],
            "{order:?}"
        );
    }

    #[test]
    fn every_component_comes_once() {
        let neighbours = vec![vec![1], vec![0], vec![], vec![4], vec![3]];
        let mut order = breadth_first(&neighbours);
        order.sort_unstable();
        assert_eq!(order, [0, 1, 2, 3, 4]);
    }
}
