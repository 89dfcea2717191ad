#include "builder/points/cell_subdomains.h"

#include <tbb/blocked_range.h>
#include <tbb/info.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <optional>
#include <span>
#include <utility>

#include "builder/scattered/cell_estimate.h"
#include "builder/sorting/morton.h"

namespace splatvol {
namespace {

// Points that next() returns at a time.
constexpr std::size_t returned_points = 4096;

}  // namespace

// The buckets below each node of stored points.
class CellSubdomains::BucketRanges {
 public:
  explicit BucketRanges(const StoredPoints& points) {
    const auto& nodes = points.nodes();
    for (std::size_t n = 0; n < nodes.size(); ++n)
      if (n < points.bucket_count())
        ranges_.emplace_back(n, n + 1);
      else
        ranges_.emplace_back(ranges_[nodes[n].begin].first, ranges_[nodes[n].end - 1].second);
  }

  [[nodiscard]] const std::pair<std::size_t, std::size_t>& operator[](std::size_t node) const { return ranges_[node]; }

 private:
  std::vector<std::pair<std::size_t, std::size_t>> ranges_;
};

// One subdomain, and the points outside that it has seen.
class CellSubdomains::Subdomain final : public Surroundings {
 public:
  Subdomain(const StoredPoints& points, const BucketRanges& ranges) : points_(points), ranges_(ranges) {}

  // Finds the cells of all points in these buckets.
  Status run(std::size_t first_bucket, std::size_t end_bucket);

  [[nodiscard]] std::size_t size() const { return positions_.size(); }

  // Appends points [begin, end) with their material.
  void append(std::size_t begin, std::size_t end, const Cube& cube, PointBatch& batch) const;

  [[nodiscard]] std::size_t root() const override { return points_.nodes().size() - 1; }
  [[nodiscard]] Node node(std::size_t number) const override {
    const StoredPoints::Node& at = points_.nodes()[number];
    return {at.box, at.begin, at.end, number < points_.bucket_count()};
  }
  [[nodiscard]] Part outside(std::size_t number) const override {
    const auto [begin, end] = ranges_[number];
    if (begin >= first_bucket_ && end <= end_bucket_) return Part::none;
    return end <= first_bucket_ || begin >= end_bucket_ ? Part::all : Part::some;
  }
  std::span<const dvec3> read(std::size_t bucket) override;

 private:
  const StoredPoints& points_;
  const BucketRanges& ranges_;
  std::size_t first_bucket_ = 0, end_bucket_ = 0;
  Status status_;  // of reading
  std::vector<std::byte> records_;
  std::vector<dvec3> positions_;
  std::vector<std::vector<double>> values_;   // [attribute][point]
  std::vector<dvec3> read_;                   // points of the last bucket outside
  std::vector<std::vector<double>> outside_;  // [attribute]: values of all points outside
  CellEstimate estimate_;
};

Status CellSubdomains::Subdomain::run(std::size_t first_bucket, std::size_t end_bucket) {
  const PointRecords& layout = points_.layout();
  first_bucket_ = first_bucket, end_bucket_ = end_bucket;
  const auto& nodes = points_.nodes();
  records_.clear();
  status_ = points_.read(nodes[first_bucket].begin, nodes[end_bucket - 1].end, records_);
  SPLATVOL_TRY(status_);
  positions_.clear();
  values_.resize(layout.attributes());
  outside_.resize(layout.attributes());
  for (auto& values : values_) values.clear();
  for (auto& values : outside_) values.clear();
  for (std::size_t at = 0; at < records_.size(); at += layout.bytes()) {
    positions_.push_back(layout.position(&records_[at]));
    for (std::size_t a = 0; a < values_.size(); ++a) values_[a].push_back(layout.value(&records_[at], a));
  }
  std::size_t coincident = 0;
  if (points_.continues(first_bucket))
    while (coincident < positions_.size() && positions_[coincident] == positions_[0]) ++coincident;
  estimate_.find(positions_, coincident, nodes.back().box, this);
  return status_;
}

std::span<const dvec3> CellSubdomains::Subdomain::read(std::size_t bucket) {
  read_.clear();
  const PointRecords& layout = points_.layout();
  const StoredPoints::Node& node = points_.nodes()[bucket];
  records_.clear();
  if (status_) status_ = points_.read(node.begin, node.end, records_);
  if (!status_) return {};
  std::optional<dvec3> last;
  for (std::size_t at = 0; at < records_.size(); at += layout.bytes()) {
    const dvec3 position = layout.position(&records_[at]);
    const bool repeats = last ? *last == position : points_.continues(bucket);
    last = position;
    if (repeats) continue;
    read_.push_back(position);
    for (std::size_t a = 0; a < outside_.size(); ++a) outside_[a].push_back(layout.value(&records_[at], a));
  }
  return read_;
}

void CellSubdomains::Subdomain::append(std::size_t begin, std::size_t end, const Cube& cube, PointBatch& batch) const {
  const std::size_t first = batch.size(), size = first + end - begin;
  const auto extend = [&](const auto& from, auto& to) {
    to.insert(to.end(), from.begin() + static_cast<std::ptrdiff_t>(begin),
              from.begin() + static_cast<std::ptrdiff_t>(end));
  };
  extend(positions_, batch.positions);
  const bool with_gradients = points_.layout().has_gradients();
  batch.keys.resize(size);
  batch.moments.resize(size);
  for (std::size_t a = 0; a < values_.size(); ++a) {
    extend(values_[a], batch.values[a]);
    batch.value_moments[a].resize(size);
    if (with_gradients) batch.gradients[a].resize(size);
  }
  tbb::parallel_for(tbb::blocked_range<std::size_t>(begin, end, 64), [&](const auto& range) {
    for (std::size_t i = range.begin(); i < range.end(); ++i) {
      const std::size_t to = first + i - begin;
      batch.keys[to] = morton_key(positions_[i], cube);
      batch.moments[to] = estimate_.moments(i);
      for (std::size_t a = 0; a < values_.size(); ++a) {
        const EstimateValues values{values_[a], outside_[a]};
        batch.value_moments[a][to] = estimate_.value(i, values);
        if (with_gradients) batch.gradients[a][to] = estimate_.gradient(i, values);
      }
    }
  });
}

CellSubdomains::CellSubdomains(std::unique_ptr<StoredPoints> points, const Cube& cube, std::size_t subdomain_points,
                               std::size_t at_once)
    : points_(std::move(points)),
      ranges_(std::make_unique<const BucketRanges>(*points_)),
      cube_(cube),
      at_once_(at_once),
      cuts_(points_->cut(subdomain_points)) {}

CellSubdomains::CellSubdomains(CellSubdomains&&) noexcept = default;
CellSubdomains& CellSubdomains::operator=(CellSubdomains&&) noexcept = default;
CellSubdomains::~CellSubdomains() = default;

std::uint64_t CellSubdomains::bytes_of_subdomain(std::size_t attributes) {
  // Cells, their neighbours, and the points outside: about as many as own ones.
  return default_subdomain_points * (600 + 24 * attributes);
}

Result<CellSubdomains> CellSubdomains::create(PointStream& stream, std::uint64_t memory, const std::string& folder,
                                              std::size_t subdomain_points) {
  SPLATVOL_TRY_ASSIGN(points, StoredPoints::create(stream, folder));
  const std::uint64_t room = memory / bytes_of_subdomain(stream.summary().attributes.size());
  const auto threads = static_cast<std::uint64_t>(tbb::info::default_concurrency());
  const std::size_t at_once = std::clamp<std::uint64_t>(room, 1, 2 * threads);
  return CellSubdomains(std::make_unique<StoredPoints>(std::move(points)), stream.summary().cube, subdomain_points,
                        at_once);
}

// Finds the cells of the next subdomains.
Status CellSubdomains::find_cells() {
  const std::size_t count = std::min(at_once_, cuts_.size() - 1 - next_);
  std::vector<Status> outcomes(count);
  for (std::size_t i = 0; i < count; ++i) {
    if (idle_.empty()) idle_.push_back(std::make_unique<Subdomain>(*points_, *ranges_));
    ready_.push_back(std::move(idle_.back()));
    idle_.pop_back();
  }
  tbb::parallel_for(std::size_t{0}, count,
                    [&](std::size_t i) { outcomes[i] = ready_[i]->run(cuts_[next_ + i], cuts_[next_ + i + 1]); });
  next_ += count;
  for (const Status& outcome : outcomes) SPLATVOL_TRY(outcome);
  return {};
}

Result<bool> CellSubdomains::next(PointBatch& batch) {
  if (ready_.empty()) SPLATVOL_TRY(find_cells());
  if (ready_.empty()) return false;
  const Subdomain& subdomain = *ready_.front();
  const std::size_t end = std::min(returned_ + returned_points, subdomain.size());
  subdomain.append(returned_, end, cube_, batch);
  returned_ = end;
  if (end == subdomain.size()) {
    idle_.push_back(std::move(ready_.front()));
    ready_.pop_front();
    returned_ = 0;
  }
  return true;
}

}  // namespace splatvol
