//! Plain groups: matches that agree, gathered greedily (SegMatch's way, after PCL's geometric consistency grouping).

use super::consistency::ConsistencyGraph;

/// The largest of the groups grown from each of `pool` (candidate indices, those to try first first): from its seed on, a
/// group takes each match that agrees with all it holds. Of groups of one size the first; ascending.
pub(super) fn largest_group(graph: &ConsistencyGraph, pool: &[u32]) -> Vec<u32> {
    // Place of each candidate in the pool; those outside come never.
    let mut rank = vec![u32::MAX; graph.len()];
    for (r, c) in pool.iter().enumerate() {
        rank[*c as usize] = r as u32;
    }
    let mut best: Vec<u32> = Vec::new();
    let mut partners = Vec::new();
    for seed in pool {
        partners.clear();
        let near = graph.neighbours(graph.vertex(*seed)).iter().map(|u| graph.candidate(*u));
        partners.extend(near.filter(|c| rank[*c as usize] != u32::MAX));
        if partners.len() < best.len() {
            continue;
        }
        partners.sort_unstable_by_key(|c| rank[*c as usize]);
        let mut group = vec![*seed];
        for c in &partners {
            if group[1..].iter().all(|g| graph.agree(*g, *c)) {
                group.push(*c);
            }
        }
        if group.len() > best.len() {
            best = group;
        }
    }
    best.sort_unstable();
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_group_takes_what_agrees_with_all_of_it_in_the_order_of_the_pool() {
        // 0-1-2-3 all agree, 4 agrees with 0 and 1 only.
        let edges = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3), (0, 4), (1, 4)];
        let graph = ConsistencyGraph::from_edges(5, &edges);
        assert_eq!(largest_group(&graph, &[0, 1, 2, 3, 4]), [0, 1, 2, 3]);
        // Greed: with 4 first, groups from 0 and 1 take it and nothing fits any more; that of 2 is grown from 0.
        assert_eq!(largest_group(&graph, &[4, 0, 1, 2]), [0, 1, 4]);
        assert_eq!(largest_group(&graph, &[3, 1]), [1, 3]);
        assert_eq!(largest_group(&graph, &[]), Vec::<u32>::new());
    }
}
