#include "builder/pipeline/preview.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "format/codec.h"

namespace splatvol {
namespace {

// Points whose values are looked at together.
constexpr std::size_t slice_points = std::size_t{1} << 16;

// A point with its values. Points are ordered by a hash of their positions.
struct SampledPoint {
  std::uint64_t hash = 0;
  dvec3 position{};
  std::vector<double> values;  // [attribute]
};

std::uint64_t hash_of(const dvec3& position) { return format::hash_bytes(std::as_bytes(std::span(&position, 1))); }

bool is_before(const SampledPoint& a, const SampledPoint& b) {
  if (a.hash != b.hash) return a.hash < b.hash;
  return std::ranges::lexicographical_compare(a.values, b.values);
}

// The points of a mesh that its cells use; empty: all points are used.
std::vector<bool> used_points(const Piece& piece) {
  if (piece.tetrahedra.empty()) return {};
  std::vector<bool> used(piece.points.size());
  for (const auto& corners : piece.tetrahedra)
    for (const std::uint32_t corner : corners) used[corner] = true;
  return used;
}

// Takes the points with the lowest hashes, and those that bound positions and values.
class Sampler {
 public:
  explicit Sampler(std::size_t attributes) : extremes_(2 * (3 + attributes)), values_(attributes) {}

  void add(const Piece& piece) {
    const std::vector<bool> used = used_points(piece);
    std::vector<std::uint32_t> points;
    for (std::size_t i = 0; i < piece.points.size(); ++i) {
      if (is_usable_position(piece.points[i]) && (used.empty() || used[i]))
        points.push_back(static_cast<std::uint32_t>(i));
      if (points.size() < slice_points && i + 1 < piece.points.size()) continue;
      add_slice(piece, points);
      points.clear();
    }
  }

  // Points that were added.
  [[nodiscard]] std::uint64_t count() const { return count_; }

  // Returns the sample as a piece. Called once.
  std::unique_ptr<Piece> take() {
    for (const Extreme& extreme : extremes_)
      if (extreme.point) points_.push_back(*extreme.point);
    keep(points_.size());
    auto piece = std::make_unique<Piece>();
    piece->values.resize(values_.size());
    for (const SampledPoint& point : points_) {
      piece->points.push_back(point.position);
      for (std::size_t a = 0; a < values_.size(); ++a) piece->values[a].push_back(point.values[a]);
    }
    points_ = {};
    return piece;
  }

 private:
  // The point with the lowest or highest coordinate or value; of several, that with the lowest hash.
  struct Extreme {
    double value = 0;
    std::optional<SampledPoint> point;

    // Whether a point takes the place of this one. A missing value does not.
    [[nodiscard]] bool yields_to(double other, bool highest, std::uint64_t hash) const {
      if (!(std::abs(other) <= largest_value)) return false;
      if (!point || other == value) return !point || hash < point->hash;
      return highest ? other > value : other < value;
    }
  };

  void add_slice(const Piece& piece, std::span<const std::uint32_t> points) {
    count_ += points.size();
    for (std::size_t a = 0; a < values_.size(); ++a) {
      values_[a].resize(points.size());
      if (piece.lent) {
        piece.lent->get(a, points, values_[a]);
      } else {
        for (std::size_t i = 0; i < points.size(); ++i) values_[a][i] = piece.values[a][points[i]];
      }
    }
    for (std::size_t i = 0; i < points.size(); ++i) {
      const dvec3& position = piece.points[points[i]];
      const std::uint64_t hash = hash_of(position);
      if (hash <= most_hash_) points_.push_back(point(hash, position, i));
      for (std::size_t number = 0; number < 3 + values_.size(); ++number) {
        const double value = number < 3 ? position[static_cast<int>(number)] : values_[number - 3][i];
        for (const bool highest : {false, true}) {
          Extreme& extreme = extremes_[2 * number + (highest ? 1 : 0)];
          if (extreme.yields_to(value, highest, hash)) extreme = {value, point(hash, position, i)};
        }
      }
    }
    if (points_.size() > 2 * Preview::most_points) keep(Preview::most_points);
  }

  [[nodiscard]] SampledPoint point(std::uint64_t hash, const dvec3& position, std::size_t i) const {
    SampledPoint made{.hash = hash, .position = position, .values = {}};
    for (const std::vector<double>& values : values_) made.values.push_back(values[i]);
    return made;
  }

  // Keeps the first points, each position once.
  void keep(std::size_t most) {
    std::ranges::sort(points_, is_before);
    const auto same = [](const SampledPoint& a, const SampledPoint& b) {
      return a.hash == b.hash && a.position == b.position;
    };
    const auto repeated = std::ranges::unique(points_, same);
    points_.erase(repeated.begin(), repeated.end());
    if (points_.size() <= most) return;
    points_.resize(most);
    most_hash_ = points_.back().hash;
  }

  std::vector<SampledPoint> points_;
  std::vector<Extreme> extremes_;            // of each axis, then of each attribute: lowest and highest
  std::vector<std::vector<double>> values_;  // [attribute]: of the slice
  std::uint64_t most_hash_ = std::numeric_limits<std::uint64_t>::max();
  std::uint64_t count_ = 0;
};

// The sample as an input of one piece.
class SampleSource final : public Source {
 public:
  SampleSource(const Source& whole, std::unique_ptr<Piece> sample)
      : attributes_(whole.attributes()),
        units_(whole.units()),
        components_(whole.components()),
        points_(sample->points.size()),
        sample_(std::move(sample)) {}

  const std::vector<std::string>& attributes() const override { return attributes_; }
  std::vector<std::string> units() const override { return units_; }
  std::vector<int> components() const override { return components_; }
  std::size_t piece_count() const override { return 1; }
  std::optional<std::uint64_t> point_count() const override { return points_; }
  bool may_have_cells() const override { return false; }
  Result<std::unique_ptr<Piece>> next() override { return std::move(sample_); }

 private:
  std::vector<std::string> attributes_, units_;
  std::vector<int> components_;
  std::uint64_t points_;
  std::unique_ptr<Piece> sample_;
};

}  // namespace

// Passes all on. Its pieces go through the sampler.
class Preview::WatchedSource final : public Source {
 public:
  WatchedSource(Preview& preview, std::unique_ptr<Source> source)
      : preview_(preview), source_(std::move(source)), sampler_(std::in_place, source_->attributes().size()) {}

  Result<std::unique_ptr<Piece>> next() override {
    SPLATVOL_TRY_ASSIGN(piece, source_->next());
    if (preview_.is_over_) sampler_.reset();
    if (sampler_ && piece) sampler_->add(*piece);
    if (sampler_ && !piece) SPLATVOL_TRY(finish());
    return piece;
  }

  const std::vector<std::string>& attributes() const override { return source_->attributes(); }
  std::vector<std::string> units() const override { return source_->units(); }
  std::vector<int> components() const override { return source_->components(); }
  void lend_values() override { source_->lend_values(); }
  void tell_whole_cells() override { source_->tell_whole_cells(); }
  std::size_t piece_count() const override { return source_->piece_count(); }
  std::vector<std::uint64_t> part_sizes() override { return source_->part_sizes(); }
  Status select(const std::vector<std::uint64_t>& parts) override { return source_->select(parts); }
  PieceNumber piece_number() const override { return source_->piece_number(); }
  Result<std::optional<Box>> bounds() override { return source_->bounds(); }
  std::optional<std::uint64_t> point_count() const override { return source_->point_count(); }
  std::optional<TimeStep> time_step() const override { return source_->time_step(); }
  std::optional<double> stated_time() const override { return source_->stated_time(); }
  std::vector<std::string> conversions() const override { return source_->conversions(); }
  std::uint64_t left_out_cells() const override { return source_->left_out_cells(); }
  bool averages_by_piece() const override { return source_->averages_by_piece(); }
  VertexCopies copies() const override { return source_->copies(); }
  bool may_have_cells() const override { return source_->may_have_cells(); }
  bool brings_material() const override { return source_->brings_material(); }
  bool single_precision() const override { return source_->single_precision(); }

 private:
  Status finish() {
    preview_.is_over_ = true;
    const bool is_wanted = sampler_->count() > least_input;
    std::unique_ptr<Piece> piece = is_wanted ? sampler_->take() : nullptr;
    sampler_.reset();
    if (!piece) return {};
    SampleSource sample(*source_, std::move(piece));
    return preview_.write(sample);
  }

  Preview& preview_;
  std::unique_ptr<Source> source_;
  std::optional<Sampler> sampler_;  // none: there is nothing more to do
};

Preview::Preview(std::string path, BuildOptions options, std::function<void(const std::string&)> done)
    : path_(std::move(path)), options_(std::move(options)), done_(std::move(done)) {
  options_.connectivity = Connectivity::boxes;
  options_.temp_folder.clear();
  options_.keep_cells = false;
  options_.boundary_triangles = 0;
  options_.strict = false;
}

std::unique_ptr<Source> Preview::watch(std::unique_ptr<Source> source) {
  return std::make_unique<WatchedSource>(*this, std::move(source));
}

Status Preview::write(Source& sample) {
  const auto report = build_volume(sample, path_, options_, [](const char*, double) {});
  if (!report) return tl::unexpected(report.error());
  done_(path_);
  return {};
}

}  // namespace splatvol
