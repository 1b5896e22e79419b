//! Bounding volume hierarchy: a tree of boxes over many items, which finds the distance from a point to the nearest
//! item.
//!
//! Items are sorted so that the items of a leaf lie side by side in memory. Boxes are `f32`, rounded outwards, so that
//! a node takes half a cache line. Everything else is `f64`. The result does not depend on the machine or on the number
//! of threads.

use nalgebra::Vector3;

/// A box with sides along the axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// Smallest coordinates.
    pub min: Vector3<f64>,
    /// Greatest coordinates.
    pub max: Vector3<f64>,
}

impl Bounds {
    /// An empty box.
    pub const EMPTY: Self = Self {
        min: Vector3::new(f64::INFINITY, f64::INFINITY, f64::INFINITY),
        max: Vector3::new(f64::NEG_INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY),
    };

    /// Returns the smallest box that contains these points.
    pub fn of(points: &[Vector3<f64>]) -> Self {
        points.iter().fold(Self::EMPTY, |bounds, point| bounds.with(&Self { min: *point, max: *point }))
    }

    /// Returns the smallest box that contains this box and `other`.
    pub fn with(&self, other: &Self) -> Self {
        Self { min: self.min.inf(&other.min), max: self.max.sup(&other.max) }
    }

    /// Returns the box enlarged by `by` on every side.
    pub fn inflated(&self, by: f64) -> Self {
        let by = Vector3::repeat(by);
        Self { min: self.min - by, max: self.max + by }
    }

    /// Reports whether the box is empty.
    pub fn is_empty(&self) -> bool {
        self.min.x > self.max.x
    }
}

/// An item of a [`Bvh`], whose distance from a point can be computed.
pub trait BvhItem: Copy {
    /// Returns a box that contains the item.
    fn bounds(&self) -> Bounds;
    /// Returns the minimum of `best` and the signed squares of the distances from a point to these items.
    ///
    /// A distance inside an item is negative, and its signed square is negative too.
    fn nearest(items: &[Self], point: &Vector3<f64>, best: f64) -> f64;
}

/// Returns the square of a distance, with the sign of the distance.
pub fn signed_square(distance: f64) -> f64 {
    distance * distance.abs()
}

/// Returns the signed distance that has this [`signed_square`].
pub fn signed_root(square: f64) -> f64 {
    if square < 0.0 { -(-square).sqrt() } else { square.sqrt() }
}

/// A bounding volume hierarchy over items.
#[derive(Debug, Clone)]
pub struct Bvh<T> {
    nodes: Vec<Node>,
    items: Vec<T>,
}

/// A node of the tree: a box and its content, which is either two child nodes or a range of items.
#[derive(Debug, Clone, Copy)]
struct Node {
    min: [f32; 3],
    max: [f32; 3],
    /// Index of the first item of the node or, if `items` is 0, of the first of its two adjacent child nodes.
    first: u32,
    items: u32,
}

/// Maximum number of items in a leaf.
const LEAF: usize = 8;
/// Maximum number of levels of a tree. Each level halves the number of items, which is below 2^32.
const MAX_DEPTH: usize = 40;

impl Node {
    fn new(bounds: &Bounds, first: usize, items: usize) -> Self {
        let down = |value: f64| if f64::from(value as f32) > value { (value as f32).next_down() } else { value as f32 };
        let up = |value: f64| if f64::from(value as f32) < value { (value as f32).next_up() } else { value as f32 };
        let (min, max) = (bounds.min, bounds.max);
        Self {
            min: [down(min.x), down(min.y), down(min.z)],
            max: [up(max.x), up(max.y), up(max.z)],
            first: first as u32,
            items: items as u32,
        }
    }

    /// Returns the square of the distance from a point to the box.
    #[inline]
    fn square(&self, point: &Vector3<f64>) -> f64 {
        let beside = |min: f32, max: f32, at: f64| (f64::from(min) - at).max(at - f64::from(max)).max(0.0);
        let x = beside(self.min[0], self.max[0], point.x);
        let y = beside(self.min[1], self.max[1], point.y);
        let z = beside(self.min[2], self.max[2], point.z);
        x * x + y * y + z * z
    }
}

impl<T: BvhItem> Bvh<T> {
    /// Builds the tree over these items, whose number must be below 2^31.
    pub fn new(mut items: Vec<T>) -> Self {
        let mut nodes = Vec::with_capacity(items.len() / 2 + 1);
        if !items.is_empty() {
            let bounds = bounds_of(&items);
            nodes.push(Node::new(&bounds, 0, 0));
            divide(&mut items, 0, 0, &mut nodes);
        }
        Self { nodes, items }
    }

    /// Returns the items, in the order of the tree.
    pub fn items(&self) -> &[T] {
        &self.items
    }

    /// Returns the minimum of `best` and the signed squares of the distances from a point to all items.
    #[inline]
    pub fn min_signed_square(&self, point: &Vector3<f64>, mut best: f64) -> f64 {
        let Some(root) = self.nodes.first() else { return best };
        let mut waiting = [(0.0_f64, 0_u32); MAX_DEPTH];
        let mut count = 0_usize;
        let (mut square, mut node) = (root.square(point), root);
        loop {
            // Inside an item the distance is below 0, so every box that contains the point must be examined.
            if square < best || square == 0.0 {
                if node.items > 0 {
                    let items = self.items.get(node.first as usize..(node.first + node.items) as usize);
                    best = T::nearest(items.unwrap_or(&[]), point, best);
                } else if let Some([left, right]) =
                    self.nodes.get(node.first as usize..).and_then(|nodes| nodes.first_chunk())
                {
                    let (a, b) = (left.square(point), right.square(point));
                    let (near, far) =
                        if a <= b { ((a, left), (b, node.first + 1)) } else { ((b, right), (a, node.first)) };
                    if let Some(place) = waiting.get_mut(count) {
                        *place = far;
                        count += 1;
                    }
                    (square, node) = near;
                    continue;
                }
            }
            let Some((next, index)) = count.checked_sub(1).and_then(|last| waiting.get(last)) else { return best };
            count -= 1;
            let Some(found) = self.nodes.get(*index as usize) else { return best };
            (square, node) = (*next, found);
        }
    }

    /// Calls `visit` with the items of every leaf whose box contains the coordinates `y` and `z`, at any x.
    pub fn along_x(&self, y: f64, z: f64, mut visit: impl FnMut(&[T])) {
        let mut waiting = vec![0_u32];
        while let Some(node) = waiting.pop().and_then(|index| self.nodes.get(index as usize)) {
            let covers = |axis: usize, at: f64| f64::from(node.min[axis]) <= at && at <= f64::from(node.max[axis]);
            if self.items.is_empty() || !covers(1, y) || !covers(2, z) {
                continue;
            }
            if node.items > 0 {
                let items = self.items.get(node.first as usize..(node.first + node.items) as usize);
                visit(items.unwrap_or(&[]));
            } else {
                waiting.extend([node.first, node.first + 1]);
            }
        }
    }
}

/// Returns the bounding box of some items.
pub fn bounds_of<T: BvhItem>(items: &[T]) -> Bounds {
    items.iter().fold(Bounds::EMPTY, |bounds, item| bounds.with(&item.bounds()))
}

/// Adds the nodes below the node with the index `node`, which contains `items`. `first` is the index of `items[0]`
/// among all items.
fn divide<T: BvhItem>(items: &mut [T], first: usize, node: usize, nodes: &mut Vec<Node>) {
    if items.len() <= LEAF {
        nodes[node].first = first as u32;
        nodes[node].items = items.len() as u32;
        return;
    }
    let mut centres = Bounds::EMPTY;
    for item in &*items {
        let centre = centre(item);
        centres = centres.with(&Bounds { min: centre, max: centre });
    }
    let axis = (centres.max - centres.min).imax();
    // Puts whole leaves on the left.
    let middle = (items.len() / 2).next_multiple_of(LEAF).min(items.len() - 1);
    items.select_nth_unstable_by(middle, |a, b| centre(a)[axis].total_cmp(&centre(b)[axis]));
    let (left, right) = items.split_at_mut(middle);
    let children = nodes.len();
    nodes.push(Node::new(&bounds_of(left), 0, 0));
    nodes.push(Node::new(&bounds_of(right), 0, 0));
    nodes[node].first = children as u32;
    divide(left, first, children, nodes);
    divide(right, first + middle, children + 1, nodes);
}

fn centre<T: BvhItem>(item: &T) -> Vector3<f64> {
    let bounds = item.bounds();
    (bounds.min + bounds.max) * 0.5
}
