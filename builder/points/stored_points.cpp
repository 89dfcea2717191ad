#include "builder/points/stored_points.h"

#include <algorithm>
#include <cmath>
#include <span>
#include <utility>

#include "builder/sorting/octree_nodes.h"
#include "format/codec.h"

namespace splatvol {
namespace {

PointBatch empty_batch(std::size_t attributes) {
  PointBatch batch;
  batch.values.resize(attributes);
  return batch;
}

void erase_front(PointBatch& batch, std::size_t count) {
  const auto erase = [&](auto& items) {
    items.erase(items.begin(), items.begin() + static_cast<std::ptrdiff_t>(count));
  };
  erase(batch.keys);
  erase(batch.positions);
  for (auto& values : batch.values) erase(values);
}

}  // namespace

Result<StoredPoints> StoredPoints::create(PointStream& stream, const std::string& folder) {
  SPLATVOL_TRY_ASSIGN(file, TempFile::create(folder));
  // A search reads whole buckets, so small ones read few points in vain; but the number of buckets is bounded.
  const std::size_t most = std::max<std::size_t>(32, stream.count() >> 19);
  StoredPoints stored(stream.layout(), std::move(file), stream.summary().cube, most);
  PointBatch held = empty_batch(stored.layout_.attributes());
  Last last;
  for (bool ended = false; !ended;) {
    SPLATVOL_TRY_ASSIGN(more, stream.next(held));
    ended = !more;
    std::size_t begin = 0;
    while (begin < held.size() && (ended || begin + 2 * most < held.size()))
      begin = stored.add_bucket(held, begin, last);
    SPLATVOL_TRY(stored.append_records(held, begin));
    erase_front(held, begin);
  }
  stored.build_tree();
  return stored;
}

// Adds the bucket that begins with a held point: the largest octree node with at most most_ points, and siblings that
// follow it, at most so many points in all. Returns its end among the held points. Requires that more than 2 most_
// points are held from there on, or all.
std::size_t StoredPoints::add_bucket(const PointBatch& held, std::size_t begin, Last& last) {
  const int shared = last.key ? common_depth(*last.key, held.keys[begin]) : -1;
  const KeyLeaf first = leaf_part_at(held.keys, begin, most_, shared);
  std::size_t end = first.end;
  while (end < held.size() && common_depth(held.keys[begin], held.keys[end]) == first.depth - 1) {
    const KeyLeaf sibling = leaf_part_at(held.keys, end, most_, first.depth - 1);
    if (sibling.depth != first.depth || sibling.end - begin > most_) break;
    end = sibling.end;
  }
  const std::size_t stored = nodes_.empty() ? 0 : nodes_.back().end;
  Node bucket{{}, 0, stored, stored + end - begin};
  shared_.push_back(static_cast<std::int8_t>(shared));
  depths_.push_back(static_cast<std::int8_t>(first.depth));
  continues_.push_back(last.position == held.positions[begin]);
  for (std::size_t i = begin; i < end; ++i) {
    if (last.position != held.positions[i]) bucket.box.include(held.positions[i]);
    last.position = held.positions[i];
  }
  last.key = held.keys[end - 1];
  nodes_.push_back(bucket);
  return end;
}

// Appends the records of the first `count` held points to the file.
Status StoredPoints::append_records(const PointBatch& held, std::size_t count) {
  std::vector<std::byte> records(count * layout_.bytes());
  for (std::size_t i = 0; i < count; ++i) {
    std::byte* record = records.data() + i * layout_.bytes();
    layout_.set_position(record, held.positions[i]);
    for (std::size_t a = 0; a < layout_.attributes(); ++a) layout_.set_value(record, a, held.values[a][i]);
  }
  for (std::size_t at = 0; hashes_.size() < nodes_.size();) {
    const Node& bucket = nodes_[hashes_.size()];
    const std::size_t bytes = (bucket.end - bucket.begin) * layout_.bytes();
    hashes_.push_back(format::hash_bytes(std::span(records).subspan(at, bytes)));
    at += bytes;
  }
  return file_.append(records);
}

// A parent has two to eight nodes. It ends where the largest octree node ends, so it does not reach from one large
// octree node into the next.
void StoredPoints::build_tree() {
  buckets_ = nodes_.size();
  constexpr std::size_t most_children = 8;
  std::vector<std::int8_t> shared = shared_;  // of the nodes of a layer, as shared_ of the buckets
  for (std::size_t begin = 0, end = nodes_.size(); end - begin > 1; begin = std::exchange(end, nodes_.size())) {
    std::vector<std::int8_t> shared_above;
    const auto parent_end = [&](std::size_t first) {
      std::size_t best = std::min(first + 2, end);
      for (std::size_t next = best; next <= first + most_children; ++next) {
        if (next == end) return end;
        if (shared[next - begin] <= shared[best - begin]) best = next;
      }
      return best;
    };
    for (std::size_t first = begin; first < end;) {
      Node node{{}, 0, first, parent_end(first)};
      for (std::size_t child = node.begin; child < node.end; ++child) {
        node.box.include(nodes_[child].box);
        nodes_[child].parent = nodes_.size();
      }
      shared_above.push_back(shared[first - begin]);
      first = node.end;
      nodes_.push_back(node);
    }
    shared = std::move(shared_above);
  }
  nodes_.back().parent = nodes_.size() - 1;
}

std::vector<std::size_t> StoredPoints::cut(std::size_t subdomain_points) const {
  std::vector<std::size_t> cuts{0};
  for (std::size_t begin = 0; begin < buckets_; begin = cuts.back()) {
    const std::size_t first = nodes_[begin].begin;
    std::size_t best = begin + 1;
    for (std::size_t end = begin + 1; nodes_[end - 1].end - first <= subdomain_points; ++end) {
      // Every node ends at the last bucket. A cut in the first half of a subdomain would make subdomains small.
      const bool late = nodes_[end - 1].end - first > subdomain_points / 2;
      if (end == buckets_) {
        best = end;
        break;
      }
      if (!late || nodes_[best - 1].end - first <= subdomain_points / 2 || shared_[end] <= shared_[best]) best = end;
    }
    cuts.push_back(best);
  }
  return cuts;
}

double StoredPoints::spacing(std::size_t bucket) const {
  constexpr std::size_t few = 8;
  const Node& node = nodes_[bucket];
  const dvec3 extent = node.box.extent();
  const std::size_t points = node.end - node.begin;
  const auto diagonal = [&](int depth) { return std::sqrt(3.0) * std::ldexp(cube_.edge, -depth); };
  const int depth = depths_[bucket];
  // A finest node has coincident points: the node that also holds the point before them tells where others are.
  if (depth == max_morton_depth) return diagonal(shared_[bucket]);
  // The box of few points, or of a line of them, may be small beside the distances to their neighbours. The octree node
  // above has more than most_ points.
  const double thin = std::ldexp(cube_.edge, -depth) / 2;
  if (points < few || std::min({extent.x, extent.y, extent.z}) < thin)
    return diagonal(depth - 1) / std::cbrt(static_cast<double>(most_));
  return glm::length(extent) / std::cbrt(static_cast<double>(points));
}

Status StoredPoints::read(std::size_t begin, std::size_t end, std::vector<std::byte>& records) const {
  const std::size_t before = records.size();
  records.resize(before + (end - begin) * layout_.bytes());
  SPLATVOL_TRY(file_.read(begin * layout_.bytes(), std::span(records).subspan(before)));
  const auto buckets = std::span(nodes_).first(buckets_);
  auto bucket = static_cast<std::size_t>(std::ranges::lower_bound(buckets, begin, {}, &Node::begin) - buckets.begin());
  for (std::size_t at = before; at < records.size(); ++bucket) {
    const std::size_t bytes = (buckets[bucket].end - buckets[bucket].begin) * layout_.bytes();
    if (format::hash_bytes(std::span(records).subspan(at, bytes)) != hashes_[bucket]) return fail_changed_temporary();
    at += bytes;
  }
  return {};
}

}  // namespace splatvol
