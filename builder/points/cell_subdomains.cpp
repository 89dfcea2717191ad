#include "builder/points/cell_subdomains.h"

#include <tbb/blocked_range.h>
#include <tbb/info.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <limits>
#include <unordered_map>
#include <utility>

#include "builder/scattered/sampled_cells.h"
#include "builder/sorting/morton.h"

namespace splatvol {
namespace {

// Points outside a subdomain matter up to so many usual distances between points.
constexpr double reach_in_spacings = 2;

// The middle of a box stands for all points in it if the box is smaller than this share of that reach.
constexpr double stand_in_share = 0.125;

// Cells, their neighbours, and the points outside, which may be several times as many as own ones.
std::uint64_t bytes_of_subdomain(std::size_t attributes) {
  return CellSubdomains::default_subdomain_points * (1600 + 32 * attributes);
}

}  // namespace

// One subdomain, and points near it.
class CellSubdomains::Subdomain {
 public:
  explicit Subdomain(const StoredPoints& points) : points_(points) {}

  // Finds the cells of all points in these buckets.
  Status run(std::size_t first_bucket, std::size_t end_bucket) {
    first_bucket_ = first_bucket, end_bucket_ = end_bucket;
    const auto& nodes = points_.nodes();
    positions_.clear();
    values_.resize(points_.layout().attributes());
    for (auto& values : values_) values.clear();
    SPLATVOL_TRY(read(nodes[first_bucket].begin, nodes[end_bucket - 1].end));
    own_ = positions_.size();
    std::size_t coincident = 0;
    if (points_.continues(first_bucket))
      while (coincident < own_ && positions_[coincident] == positions_[0]) ++coincident;
    look_round();
    SPLATVOL_TRY(read_surroundings(nodes.size() - 1));
    cells_.find(positions_, own_, coincident);
    return {};
  }

  // Points of the subdomain.
  [[nodiscard]] std::size_t size() const { return own_; }

  void append(std::size_t begin, std::size_t end, const Cube& cube, PointBatch& batch) const {
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
        batch.moments[to] = cells_.moments(i);
        for (std::size_t a = 0; a < values_.size(); ++a) {
          batch.value_moments[a][to] = cells_.value(i, values_[a]);
          if (with_gradients) batch.gradients[a][to] = cells_.gradient(i, values_[a]);
        }
      }
    });
  }

 private:
  // How a node outside is seen.
  enum class Seen : std::uint8_t { not_at_all, from_afar, near };
  // Round a few buckets of the subdomain.
  struct Around {
    Box box;
    double reach;
  };

  Status read(std::size_t begin, std::size_t end) {
    const PointRecords& layout = points_.layout();
    records_.clear();
    SPLATVOL_TRY(points_.read(begin, end, records_));
    for (std::size_t at = 0; at < records_.size(); at += layout.bytes()) {
      positions_.push_back(layout.position(&records_[at]));
      for (std::size_t a = 0; a < values_.size(); ++a) values_[a].push_back(layout.value(&records_[at], a));
    }
    return {};
  }

  [[nodiscard]] bool has_own_bucket(std::size_t number) const {
    const auto& nodes = points_.nodes();
    std::size_t first = number, last = number;
    while (first >= points_.bucket_count()) first = nodes[first].begin;
    while (last >= points_.bucket_count()) last = nodes[last].end - 1;
    return first < end_bucket_ && last >= first_bucket_;
  }

  void look_round() {
    const auto& nodes = points_.nodes();
    seen_.clear();
    for (std::size_t bucket = first_bucket_; bucket < end_bucket_; ++bucket)
      look_at(nodes.size() - 1, {nodes[bucket].box, reach_in_spacings * points_.spacing(bucket)});
  }

  void look_at(std::size_t number, const Around& around) {
    const StoredPoints::Node& node = points_.nodes()[number];
    const bool is_bucket = number < points_.bucket_count(), has_own = has_own_bucket(number);
    if (is_bucket && has_own) return;
    if (node.box.low.x > node.box.high.x) return;
    const double square = squared_distance(node.box, around.box);
    if (square > around.reach * around.reach) return;
    Seen& seen = seen_[number];
    const double small = stand_in_share * around.reach;
    if (!has_own && squared_length(node.box.extent()) < small * small) {
      seen = std::max(seen, Seen::from_afar);
      return;
    }
    seen = Seen::near;
    if (is_bucket) return;
    for (std::size_t child = node.begin; child < node.end; ++child) look_at(child, around);
  }

  Status read_surroundings(std::size_t number) {
    const auto seen = seen_.find(number);
    if (seen == seen_.end() || seen->second == Seen::not_at_all) return {};
    const StoredPoints::Node& node = points_.nodes()[number];
    if (seen->second == Seen::from_afar) {
      add_stand_in(node.box);
      return {};
    }
    if (number < points_.bucket_count()) return read(node.begin, node.end);
    for (std::size_t child = node.begin; child < node.end; ++child) SPLATVOL_TRY(read_surroundings(child));
    return {};
  }

  void add_stand_in(const Box& box) {
    positions_.push_back((box.low + box.high) / 2.0);
    for (auto& values : values_) values.push_back(std::numeric_limits<double>::quiet_NaN());
  }

  const StoredPoints& points_;
  std::size_t first_bucket_ = 0, end_bucket_ = 0, own_ = 0;
  std::vector<std::byte> records_;
  std::vector<dvec3> positions_;             // of the subdomain, then near it
  std::vector<std::vector<double>> values_;  // [attribute][position]; missing where a position stands for many points
  std::unordered_map<std::size_t, Seen> seen_;
  SampledCells cells_;
};

CellSubdomains::CellSubdomains(std::unique_ptr<StoredPoints> points, const Cube& cube, std::size_t subdomain_points,
                               std::size_t at_once)
    : points_(std::move(points)), cube_(cube), at_once_(at_once), cuts_(points_->cut(subdomain_points)) {}

CellSubdomains::CellSubdomains(CellSubdomains&&) noexcept = default;
CellSubdomains& CellSubdomains::operator=(CellSubdomains&&) noexcept = default;
CellSubdomains::~CellSubdomains() = default;

std::uint64_t CellSubdomains::memory() const {
  return points_->memory() + at_once_ * bytes_of_subdomain(points_->layout().attributes());
}

std::uint64_t CellSubdomains::least_memory() const {
  return points_->memory() + bytes_of_subdomain(points_->layout().attributes());
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

Status CellSubdomains::find_cells() {
  const std::size_t count = std::min(at_once_, cuts_.size() - 1 - next_);
  std::vector<Status> outcomes(count);
  for (std::size_t i = 0; i < count; ++i) {
    if (idle_.empty()) idle_.push_back(std::make_unique<Subdomain>(*points_));
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
  const std::size_t end = std::min(returned_ + points_at_once, subdomain.size());
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
