/// A binary heap of the keys of places `0..len`, largest on top. Places are taken out as by
/// [`Vec::swap_remove`]: the last one takes the number of the one that goes.
#[derive(Debug, Clone, Default)]
pub(crate) struct KeyHeap {
    /// Keys and their places, no parent (`(i - 1) / 2`) smaller than a child.
    nodes: Vec<(u64, u32)>,
    /// Where in `nodes` each place is.
    node_of: Vec<u32>,
}

impl KeyHeap {
    /// Memory of one key (bytes).
    pub const BYTES: usize = size_of::<(u64, u32)>() + size_of::<u32>();

    /// Place and key of the largest.
    pub fn largest(&self) -> Option<(usize, u64)> {
        self.nodes
            .first()
            .map(|&(key, place)| (place as usize, key))
    }

    /// Adds the key of the place after the last, in O(log n).
    pub fn push(&mut self, key: u64) {
        let (node, place) = (self.nodes.len(), self.node_of.len());
        self.nodes.push((key, place as u32));
        self.node_of.push(node as u32);
        self.sift(node);
    }

    /// Takes a place out, in O(log n).
    ///
    /// # Panics
    /// If there is no such place.
    pub fn swap_remove(&mut self, place: usize) {
        let node = self.node_of[place] as usize;
        self.nodes.swap_remove(node);
        if let Some(&(_, moved)) = self.nodes.get(node) {
            self.node_of[moved as usize] = node as u32;
            self.sift(node);
        }
        self.node_of.swap_remove(place);
        if let Some(&node) = self.node_of.get(place) {
            self.nodes[node as usize].1 = place as u32;
        }
    }

    pub fn clear(&mut self) {
        self.nodes.clear();
        self.node_of.clear();
    }

    /// Moves a node up or down to where it belongs.
    fn sift(&mut self, mut node: usize) {
        while node > 0 && self.nodes[(node - 1) / 2].0 < self.nodes[node].0 {
            self.swap(node, (node - 1) / 2);
            node = (node - 1) / 2;
        }
        loop {
            let children = 2 * node + 1..(2 * node + 3).min(self.nodes.len());
            let Some(child) = children.max_by_key(|&child| self.nodes[child].0) else {
                return;
            };
            if self.nodes[child].0 <= self.nodes[node].0 {
                return;
            }
            self.swap(node, child);
            node = child;
        }
    }

    fn swap(&mut self, a: usize, b: usize) {
        self.nodes.swap(a, b);
        for node in [a, b] {
            self.node_of[self.nodes[node].1 as usize] = node as u32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::KeyHeap;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_largest_is_that_of_a_plain_list(
            steps in prop::collection::vec((any::<bool>(), 0u64..50, any::<prop::sample::Index>()), 0..300),
        ) {
            let (mut heap, mut keys) = (KeyHeap::default(), Vec::new());
            for (push, key, at) in steps {
                if push || keys.is_empty() {
                    heap.push(key);
                    keys.push(key);
                } else {
                    let place = at.index(keys.len());
                    heap.swap_remove(place);
                    keys.swap_remove(place);
                }
                let largest = heap.largest();
                prop_assert_eq!(largest.map(|(_, key)| key), keys.iter().max().copied());
                if let Some((place, key)) = largest {
                    prop_assert_eq!(keys[place], key);
                }
            }
        }
    }
}
