#include "builder/points/stored_points.h"

#include <algorithm>
#include <span>
#include <utility>

#include "builder/sorting/octree_nodes.h"

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
  StoredPoints stored(stream.layout(), std::move(file));
  // A search reads whole buckets, so small ones read few points in vain; but the number of buckets is bounded.
  const std::size_t most = std::max<std::size_t>(32, stream.count() >> 19);
  PointBatch held = empty_batch(stored.layout_.attributes());
  Last last;
  for (bool ended = false; !ended;) {
    SPLATVOL_TRY_ASSIGN(more, stream.next(held));
    ended = !more;
    std::size_t begin = 0;
    while (ended ? begin < held.size() : begin + most < held.size()) begin = stored.add_bucket(held, begin, most, last);
    SPLATVOL_TRY(stored.append_records(held, begin));
    erase_front(held, begin);
  }
  stored.build_tree();
  return stored;
}

// Adds the bucket that begins with a held point: the largest octree node with at most `most` points. Returns its end
// among the held points. Requires that more than `most` points are held from there on, or all.
std::size_t StoredPoints::add_bucket(const PointBatch& held, std::size_t begin, std::size_t most, Last& last) {
  const int shared = last.key ? common_depth(*last.key, held.keys[begin]) : -1;
  const std::size_t end = leaf_part_at(held.keys, begin, most, shared).end;
  const std::size_t stored = nodes_.empty() ? 0 : nodes_.back().end;
  Node bucket{{}, 0, stored, stored + end - begin};
  shared_.push_back(static_cast<std::int8_t>(shared));
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
  return file_.append(records);
}

void StoredPoints::build_tree() {
  buckets_ = nodes_.size();
  constexpr std::size_t children = 8;
  for (std::size_t begin = 0, end = nodes_.size(); end - begin > 1; begin = std::exchange(end, nodes_.size())) {
    for (std::size_t first = begin; first < end; first += children) {
      Node node{{}, 0, first, std::min(first + children, end)};
      for (std::size_t child = node.begin; child < node.end; ++child) {
        node.box.include(nodes_[child].box);
        nodes_[child].parent = nodes_.size();
      }
      nodes_.push_back(node);
    }
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

Status StoredPoints::read(std::size_t begin, std::size_t end, std::vector<std::byte>& records) const {
  const std::size_t before = records.size();
  records.resize(before + (end - begin) * layout_.bytes());
  return file_.read(begin * layout_.bytes(), std::span(records).subspan(before));
}

}  // namespace splatvol
