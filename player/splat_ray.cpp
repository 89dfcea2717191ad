#include "player/splat_ray.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <span>
#include <utility>
#include <variant>

#include "renderer/slice_values.h"
#include "renderer/transfer_table.h"
#include "splat/ellipsoid.h"
#include "splat/kernel.h"

namespace splatvol {
namespace {

constexpr std::uint32_t chunk_splats = 256;
constexpr std::size_t sample_count = 256;
constexpr double most_opaque = 1 - 1e-6;  // a picture rounds its opacity
constexpr double gaussian_reach = 4;      // deviations of a splat of the kernel octant
constexpr double octant_deviation = 0.4;  // of its size
constexpr std::size_t table_columns = 512, table_rows = 64;

// Nodes and weights of Gauss and Legendre on [-1, 1].
constexpr std::array<std::pair<double, double>, 6> chord_nodes = {{{-0.9324695142031521, 0.1713244923791704},
                                                                   {-0.6612093864662645, 0.3607615730481386},
                                                                   {-0.2386191860831969, 0.4679139345726910},
                                                                   {0.2386191860831969, 0.4679139345726910},
                                                                   {0.6612093864662645, 0.3607615730481386},
                                                                   {0.9324695142031521, 0.1713244923791704}}};

// Mean extinction of normally distributed values.
class Extinctions {
 public:
  explicit Extinctions(const TransferFunction& function)
      : function_(function), table_(make_transfer_table(function, table_columns, table_rows)) {}

  // `t`: in units of the domain.
  [[nodiscard]] double of(const AxisMoments& t) const {
    constexpr double growth = 513;  // TransferTable
    const double row =
        static_cast<double>(table_.rows - 1) * std::log1p(64 * std::max(t.deviation, 0.0)) / std::log(growth);
    const double inner = static_cast<double>(table_.columns - 1 - 2 * TransferTable::margin);
    const double last_row = static_cast<double>(table_.rows - 1);
    const std::size_t r = static_cast<std::size_t>(std::clamp(row, 0.0, last_row - 1));
    const double f = std::clamp(row - static_cast<double>(r), 0.0, 1.0);
    const auto at = [&](std::size_t j) {
      const double column =
          static_cast<double>(TransferTable::margin) + inner * ((t.mean - 0.5) / (1 + 8 * table_.spread(j)) + 0.5);
      const double last = static_cast<double>(table_.columns - 1);
      const double place = std::clamp(column, 0.0, last);
      const std::size_t i = static_cast<std::size_t>(std::min(place, last - 1));
      const double g = place - static_cast<double>(i);
      const vec4* entries = table_.entries.data() + j * table_.columns + i;
      return (1 - g) * static_cast<double>(entries[0].a) + g * static_cast<double>(entries[1].a);
    };
    return (1 - f) * at(r) + f * at(r + 1);
  }

  [[nodiscard]] double of(double value, double deviation) const { return of(function_.moments_of(value, deviation)); }

 private:
  const TransferFunction& function_;
  TransferTable table_;
};

// A splat's part of a ray, whose density has the visible share. The value is known along it.
struct SplatChord : Chord {
  bool is_gaussian = false;     // `half` is a deviation
  double value = 0, slope = 0;  // at the middle, and per distance
  double deviation = 0;         // of the values about this
  double factor = 1;            // of the opacity, on the extinction
  double optical_depth = 0;

  [[nodiscard]] double density_at(double distance) const {
    if (!is_gaussian) return density(distance);
    const double u = (distance - middle) / half;
    return peak * std::exp(-u * u / 2);
  }
  [[nodiscard]] double value_at(double distance) const { return value + slope * (distance - middle); }
};

void add_depth(SplatChord& chord, const Extinctions& extinctions) {
  const double middle = 0.5 * (chord.begin + chord.end), half = 0.5 * (chord.end - chord.begin);
  for (const auto& [node, weight] : chord_nodes) {
    const double distance = middle + node * half;
    chord.optical_depth += weight * half * chord.factor * chord.density_at(distance) *
                           extinctions.of(chord.value_at(distance), chord.deviation);
  }
}

std::optional<SplatChord> chord_of(const MomentsSplat& splat, const dvec3& origin, const DrawingUnits& units,
                                   const Looking& looking) {
  if (std::isnan(splat.value)) return {};
  // In drawing units from the block's origin; distances along the ray are those of the world.
  const dvec3 eye = (looking.ray.origin - origin) / units.length, direction = looking.ray.direction / units.length;
  const double distance = std::max(glm::dot(splat.center - eye, looking.ray.direction), 0.0);
  const double pixel = looking.pixel * (looking.orthographic ? 1 / units.length : distance);
  const double variance = pixel_variance * pixel * pixel;
  const SplatShape shape = with_thickness(splat);
  const Ellipsoid ellipsoid = ellipsoid_of(splat.center, shape, variance);
  if (!(ellipsoid.peak > 0)) return {};
  const auto chord = chord_of(ellipsoid, eye, direction);
  if (!chord || !(chord->end > 0)) return {};
  SplatChord result{*chord};
  result.begin = std::max(result.begin, 0.0);
  const LinearField field = field_of(splat.center, shape, value_of(splat), variance);
  result.value = units.value(field.at(eye + result.middle * direction));
  result.slope = units.value_scale * glm::dot(field.slope, direction);
  result.deviation = units.value_scale * field.deviation;
  return result;
}

// A ball whose centre is as opaque as the splat's.
std::optional<SplatChord> chord_of(const OctantSplat& splat, const dvec3& origin, const DrawingUnits& units,
                                   const Looking& looking) {
  const double size = units.length * static_cast<double>(splat.size), deviation = octant_deviation * size;
  if (!(size > 0) || std::isnan(splat.value)) return {};
  const dvec3 from = looking.ray.origin - origin - units.length * dvec3(splat.position);
  const double nearest = -glm::dot(from, looking.ray.direction);
  const dvec3 miss = from + nearest * looking.ray.direction;
  const double far = glm::dot(miss, miss) / (deviation * deviation);
  if (far > gaussian_reach * gaussian_reach) return {};
  SplatChord chord{};
  chord.is_gaussian = true;
  chord.middle = nearest;
  chord.half = deviation;
  chord.begin = std::max(nearest - gaussian_reach * deviation, 0.0);
  chord.end = nearest + gaussian_reach * deviation;
  if (!(chord.begin < chord.end)) return {};
  chord.peak = size / (deviation * std::sqrt(2 * std::numbers::pi)) * std::exp(-far / 2);
  chord.value = units.value(static_cast<double>(splat.value));
  return chord;
}

// The mean factor over a splat's values of the opacity attribute.
double factor_of(const Extinctions& factors, const ValueRow& row, std::uint32_t record, const DrawingUnits& units) {
  if (row.opacity().records.empty()) return 1;
  const OpacityValue& value = row.opacity().records[record];
  const double deviation = log_number(value.deviation, row.opacity().deviation_scale);
  return value.coverage / 255.0 *
         factors.of(units.opacity_offset + units.opacity_scale * static_cast<double>(value.mean),
                    units.opacity_scale * deviation);
}

dvec3 position_of(const RecordBlock& block, const PackedPosition& position, const DrawingUnits& units) {
  return block.origin + units.length * block.step * dvec3(position.offset());
}

bool is_missed(const Ray& ray, const dvec3& center, double radius) {
  const dvec3 from = center - ray.origin;
  const double along = glm::dot(from, ray.direction);
  const dvec3 miss = from - along * ray.direction;
  return along < -radius || glm::dot(miss, miss) > radius * radius;
}

// What splats sum up to in a place.
struct Sum {
  double density = 0, value = 0, depth = 0;

  void add(double density_there, double value_there, double depth_there) {
    density += density_there, value += density_there * value_there, depth += depth_there;
  }
};

// Adds a chord at equal distances. Its optical depth is that of the integral. A splat that lies between two of them
// counts at the next one.
void add_chord(const SplatChord& chord, const Extinctions& extinctions, double begin, double step,
               std::vector<Sum>& sums) {
  const auto first =
      static_cast<std::size_t>(std::clamp(std::ceil((chord.begin - begin) / step), 0.0, sample_count - 1.0));
  std::vector<double> depths;
  double sampled = 0;
  for (std::size_t i = first; i < sums.size(); ++i) {
    const double distance = begin + static_cast<double>(i) * step;
    if (distance > chord.end) break;
    depths.push_back(chord.density_at(distance) * extinctions.of(chord.value_at(distance), chord.deviation));
    sampled += depths.back();
  }
  const double middle = std::clamp(chord.middle, chord.begin, chord.end);
  if (!(sampled > 0)) sums[first].add(chord.density_at(middle), chord.value_at(middle), chord.optical_depth);
  for (std::size_t k = 0; k < depths.size(); ++k) {
    const double distance = begin + static_cast<double>(first + k) * step;
    sums[first + k].add(chord.density_at(distance), chord.value_at(distance),
                        sampled > 0 ? depths[k] / sampled * chord.optical_depth : 0);
  }
}

// The sum of all chords' densities and values at equal distances, and the opacity so far.
std::vector<Pick::Row> rows_of(const std::vector<SplatChord>& chords, const Extinctions& extinctions) {
  double begin = std::numeric_limits<double>::infinity(), end = 0;
  for (const SplatChord& chord : chords) begin = std::min(begin, chord.begin), end = std::max(end, chord.end);
  if (!(begin < end)) return {};
  const double step = (end - begin) / (sample_count - 1.0);
  std::vector<Sum> sums(sample_count);
  for (const SplatChord& chord : chords) add_chord(chord, extinctions, begin, step, sums);
  std::vector<Pick::Row> rows;
  double passed = 0;
  for (std::size_t i = 0; i < sums.size(); ++i) {
    const Sum& sum = sums[i];
    passed += sum.depth;
    rows.push_back({begin + static_cast<double>(i) * step,
                    sum.density > 0 ? sum.value / sum.density : std::numeric_limits<double>::quiet_NaN(),
                    -std::expm1(-passed)});
  }
  return rows;
}

}  // namespace

PickedSplats::PickedSplats(DrawList list, DrawList sliced, const DrawingUnits& units, std::string attribute)
    : list_(std::move(list)), sliced_(std::move(sliced)), units_(units), attribute_(std::move(attribute)) {
  for (std::uint32_t number = 0; number < list_.ranges.size(); ++number) {
    const ShapeRow& row = *list_.ranges[number].row.shapes;
    if (const auto* octants = std::get_if<std::vector<OctantShape>>(&row.records())) {
      add_chunks(number, *octants, [](const OctantShape& shape) {
        return gaussian_reach * octant_deviation * static_cast<double>(shape.size);
      });
    } else {
      const double scale = row.deviation_scale();
      add_chunks(number, std::get<std::vector<MomentsShape>>(row.records()),
                 [&](const MomentsShape& shape) { return reach_of(shape, scale); });
    }
  }
}

template <class Shape, class Reach>
void PickedSplats::add_chunks(std::uint32_t number, const std::vector<Shape>& shapes, const Reach& reach) {
  const DrawRange& range = list_.ranges[number];
  const RecordBlock& block = range.row.shapes->blocks()[range.block];
  for (std::uint32_t begin = range.begin; begin < range.begin + range.count; begin += chunk_splats) {
    const std::uint32_t end = std::min(begin + chunk_splats, range.begin + range.count);
    Box box;
    double radius = 0;
    for (std::uint32_t i = begin; i < end; ++i) {
      box.include(position_of(block, shapes[i].position, units_));
      radius = std::max(radius, units_.length * reach(shapes[i]));
    }
    chunks_.push_back(
        {0.5 * (box.low + box.high), 0.5 * glm::length(box.high - box.low) + radius, number, begin, end - begin});
  }
}

PickedSplats::OnRay PickedSplats::follow(const Transfer& transfer, const Looking& looking,
                                         std::optional<double> picture_opacity) const {
  const Extinctions extinctions(transfer.function);
  std::optional<Extinctions> factors;
  if (transfer.opacity) factors.emplace(*transfer.opacity);
  const auto& [ray, pixel, orthographic] = looking;
  std::vector<SplatChord> chords;
  for (const Chunk& chunk : chunks_) {
    const double wider = 2 * pixel * (orthographic ? 1 : glm::length(chunk.center - ray.origin) + chunk.radius);
    if (is_missed(ray, chunk.center, chunk.radius + wider)) continue;
    const DrawRange& range = list_.ranges[chunk.range];
    const RecordBlock& block = range.row.shapes->blocks()[range.block];
    const bool is_octant = std::holds_alternative<std::vector<OctantShape>>(range.row.shapes->records());
    for (std::uint32_t i = chunk.begin; i < chunk.begin + chunk.count; ++i) {
      auto chord = is_octant ? chord_of(unpack_octant(range.row, i), block.origin, units_, looking)
                             : chord_of(unpack(range.row, i), block.origin, units_, looking);
      if (!chord) continue;
      if (factors) chord->factor = factor_of(*factors, *range.row.values, i, units_);
      add_depth(*chord, extinctions);
      chords.push_back(*chord);
    }
  }
  double depth = 0;
  for (const SplatChord& chord : chords) depth += chord.optical_depth;
  if (picture_opacity && depth > 0) {
    const double scale = -std::log1p(-std::min(*picture_opacity, most_opaque)) / depth;
    for (SplatChord& chord : chords) chord.optical_depth *= scale;
  }
  return {*this, looking, rows_of(chords, extinctions)};
}

double PickedSplats::OnRay::opacity_up_to(double distance) const {
  const auto behind = std::ranges::upper_bound(rows_, distance, {}, &Pick::Row::distance);
  if (behind == rows_.begin()) return 0;
  const Pick::Row& before = *(behind - 1);
  if (behind == rows_.end()) return before.opacity;
  const double share = (distance - before.distance) / (behind->distance - before.distance);
  return before.opacity + share * (behind->opacity - before.opacity);
}

// Light is lost in front of the row that tells of it.
PickedValue PickedSplats::OnRay::value_at(double distance) const {
  PickedValue found{splats_.attribute_, std::numeric_limits<double>::quiet_NaN()};
  const auto behind = std::ranges::lower_bound(rows_, distance, {}, &Pick::Row::distance);
  if (behind != rows_.end()) found.value = behind->value;
  if (std::isnan(found.value) && behind != rows_.begin()) found.value = (behind - 1)->value;
  return found;
}

PickedValue PickedSplats::OnRay::value_on(const Plane& slice, double distance) const {
  View pixel = view_along(looking_.ray, {});
  pixel.focal = 1 / (looking_.pixel * (looking_.orthographic ? 1 : distance));
  return {splats_.attribute_,
          slice_values(splats_.sliced_, splats_.units_, pixel, slice, std::span(&distance, 1)).front()};
}

std::optional<Pick> pick_splats(const PickedSplats& splats, const Scene& scene, const TransferFunction& function,
                                std::span<const Surface> surfaces, const Looking& looking,
                                std::optional<double> opacity) {
  const Transfer transfer(function, scene.opacity ? &scene.opacity->function : nullptr);
  return pick(looking.ray, splats.follow(transfer, looking, opacity), {}, scene, surfaces, clip_region_of(scene));
}

}  // namespace splatvol
