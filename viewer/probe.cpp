#include "viewer/probe.h"

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
#include "sampler/cell_line.h"
#include "sampler/cell_sampler.h"
#include "scene/clipped_depths.h"
#include "splat/ellipsoid.h"
#include "splat/kernel.h"

namespace splatvol {
namespace {

constexpr std::uint32_t chunk_splats = 256;
constexpr std::size_t sample_count = 256;
constexpr double invisible = 1e-3;        // opacity
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

// The sum of all chords' densities and values at equal distances, and the opacity so far.
std::vector<Probe::Sample> samples_of(const std::vector<SplatChord>& chords, const Extinctions& extinctions) {
  double begin = std::numeric_limits<double>::infinity(), end = 0;
  for (const SplatChord& chord : chords) begin = std::min(begin, chord.begin), end = std::max(end, chord.end);
  const double step = (end - begin) / static_cast<double>(sample_count - 1);
  std::vector<double> density(sample_count), value(sample_count), depth(sample_count);
  for (const SplatChord& chord : chords) {
    const auto first = static_cast<std::size_t>(std::max(std::ceil((chord.begin - begin) / step), 0.0));
    for (std::size_t i = first; i < sample_count; ++i) {
      const double distance = begin + static_cast<double>(i) * step;
      if (distance > chord.end) break;
      const double d = chord.density_at(distance), v = chord.value_at(distance);
      density[i] += d;
      value[i] += d * v;
      depth[i] += d * chord.factor * extinctions.of(v, chord.deviation);
    }
  }
  double total = 0, sampled = 0;
  for (const SplatChord& chord : chords) total += chord.optical_depth;
  for (const double d : depth) sampled += d;
  const double scale = sampled > 0 ? total / sampled : 0;  // thin splats lie between samples
  std::vector<Probe::Sample> samples;
  double passed = 0;
  for (std::size_t i = 0; i < sample_count; ++i) {
    passed += depth[i] * scale;
    samples.push_back({begin + static_cast<double>(i) * step,
                       density[i] > 0 ? value[i] / density[i] : std::numeric_limits<double>::quiet_NaN(),
                       -std::expm1(-passed)});
  }
  return samples;
}

}  // namespace

Looking looking_through(const View& view, double x, double y) {
  const dvec3 aside = (x - 0.5 * view.width) / view.focal * view.right + (0.5 * view.height - y) / view.focal * view.up;
  if (view.orthographic) return {{view.eye + aside, view.forward}, 1 / view.focal, true};
  return {{view.eye, glm::normalize(view.forward + aside)}, 1 / view.focal, false};
}

ProbedFrame::ProbedFrame(DrawList list, const DrawingUnits& units) : list_(std::move(list)), units_(units) {
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
void ProbedFrame::add_chunks(std::uint32_t number, const std::vector<Shape>& shapes, const Reach& reach) {
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

std::optional<Probe> ProbedFrame::probe(const Transfer& transfer, const Looking& looking,
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
  std::ranges::sort(chords, {}, [](const SplatChord& chord) { return chord.begin + chord.end; });
  double depth = 0;
  for (const SplatChord& chord : chords) depth += chord.optical_depth;
  if (picture_opacity && depth > 0) {
    const double scale = -std::log1p(-std::min(*picture_opacity, most_opaque)) / depth;
    for (SplatChord& chord : chords) chord.optical_depth *= scale;
    depth *= scale;
  }
  const double opacity = -std::expm1(-depth);
  if (!(opacity >= invisible)) return {};
  double passed = 0;
  for (const SplatChord& chord : chords) {
    passed += chord.optical_depth;
    if (-std::expm1(-passed) < opacity / 2) continue;
    const double distance = std::clamp(chord.middle, chord.begin, chord.end);
    double density = 0, value = 0;
    for (const SplatChord& other : chords) {
      if (distance < other.begin || distance > other.end) continue;
      density += other.density_at(distance);
      value += other.density_at(distance) * other.value_at(distance);
    }
    return Probe{density > 0 ? value / density : chord.value_at(distance), ray.origin + distance * ray.direction,
                 opacity, samples_of(chords, extinctions)};
  }
  return {};
}

Result<std::shared_ptr<const ProbedCells>> ProbedCells::open(const format::Steps& steps, std::size_t step,
                                                             const std::string& attribute) {
  constexpr std::uint64_t held_bytes = std::uint64_t{16} << 20;
  SPLATVOL_TRY_ASSIGN(volume, steps.volume(step));
  if (volume->is_far()) return nullptr;
  SPLATVOL_TRY_ASSIGN(number, format::find_attribute(volume->info(), attribute, volume->name()));
  SPLATVOL_TRY_ASSIGN(cells, CellTetrahedra::open(*volume, {static_cast<std::size_t>(number)}, own_room(held_bytes)));
  if (!cells || cells->unknown_cells() > 0) return nullptr;
  return std::shared_ptr<const ProbedCells>(new ProbedCells(std::move(volume), std::move(cells)));
}

void ProbedCells::take_values(const Ray& ray, Probe& probe) const {
  constexpr double beside = 1e-5;  // a surface, of the distance: positions on it may be beside all cells by rounding
  const double offset = probe.surface.empty() ? 0 : beside * glm::length(probe.position - ray.origin);
  const std::array places = {probe.position, probe.position - offset * ray.direction,
                             probe.position + offset * ray.direction};
  const auto values = sample_cells(*cells_, std::span(places).first(probe.surface.empty() ? 1 : places.size()));
  if (!values) return;
  const auto known = std::ranges::find_if(*values, [](double value) { return !std::isnan(value); });
  if (known != values->end()) probe.value = *known;
  if (probe.samples.size() < 2) return;
  const dvec3 start = ray.origin + probe.samples.front().distance * ray.direction;
  const dvec3 end = ray.origin + probe.samples.back().distance * ray.direction;
  const auto rows = follow_line(*cells_, start, end);
  if (!rows) return;
  const LineRows samples = in_equal_steps(*rows, start, end, probe.samples.size());
  for (std::size_t i = 0; i < probe.samples.size(); ++i) probe.samples[i].value = samples.values[0][i];
}

namespace {

// A triangle of a surface that a ray meets.
struct Hit {
  double distance;
  const Surface* surface;
};

// Returns the distances at which a ray meets a mesh.
void add_hits(const Surface& surface, const View& view, const Ray& ray, std::vector<Hit>& hits) {
  const TriangleMesh& mesh = *surface.mesh;
  for (const auto& [i, j, k] : mesh.triangles) {
    const dvec3 &p = mesh.points[i], u = mesh.points[j] - p, v = mesh.points[k] - p;
    const dvec3 across = glm::cross(ray.direction, v), from = ray.origin - p, turned = glm::cross(from, u);
    const double determinant = glm::dot(u, across);
    if (determinant == 0) continue;
    const double s = glm::dot(from, across) / determinant, t = glm::dot(ray.direction, turned) / determinant;
    const double distance = glm::dot(v, turned) / determinant;
    if (!(s >= 0 && t >= 0 && s + t <= 1 && distance > 0)) continue;
    const dvec3 at = view.to_view(ray.origin + distance * ray.direction);
    const double scale = view.orthographic ? 1 : at.z;
    if (!is_clipped(view, at.x / scale, at.y / scale, at.z)) hits.push_back({distance, &surface});
  }
}

// Returns the opacity of the volume up to a distance.
double opacity_up_to(const std::optional<Probe>& volume, double distance) {
  double opacity = 0;
  if (volume)
    for (const Probe::Sample& sample : volume->samples)
      if (sample.distance <= distance) opacity = sample.opacity;
  return opacity;
}

}  // namespace

std::optional<Probe> with_surfaces(std::optional<Probe> volume, std::span<const Surface> surfaces, const View& view,
                                   const Ray& ray) {
  std::vector<Hit> hits;
  for (const Surface& surface : surfaces)
    if (surface.is_visible()) add_hits(surface, view, ray, hits);
  std::ranges::sort(hits, {}, &Hit::distance);
  double through = 1, before = 0, of_volume = 0, most = 0;  // shares of the light; `through`: what surfaces let pass
  const Hit* largest = nullptr;
  for (const Hit& hit : hits) {
    const double opacity = opacity_up_to(volume, hit.distance);
    of_volume += through * (opacity - before);
    const double share = through * (1 - opacity) * hit.surface->style.opacity;
    if (share > most) most = share, largest = &hit;
    through *= 1 - hit.surface->style.opacity;
    before = opacity;
  }
  of_volume += through * ((volume ? volume->opacity : 0) - before);
  if (!largest || most <= of_volume) return volume;
  const SceneSurface& style = largest->surface->style;
  Probe probe = volume ? *std::move(volume) : Probe{};
  probe.value = std::numeric_limits<double>::quiet_NaN();
  probe.position = ray.origin + largest->distance * ray.direction;
  probe.opacity = 1 - through * (1 - probe.opacity);
  probe.surface = style.boundary.empty() ? style.file : style.boundary;
  return probe;
}

std::optional<Probe> probe_slices(const DrawList& sliced, const DrawingUnits& units, const View& view, const Ray& ray) {
  // A picture of one pixel, whose ray is this one.
  View pixel = view;
  pixel.width = pixel.height = 1;
  pixel.eye = ray.origin;
  pixel.forward = ray.direction;
  const dvec3 right = view.right - glm::dot(view.right, ray.direction) * ray.direction;
  if (!(glm::length(right) > 0)) return {};
  pixel.right = glm::normalize(right);
  pixel.up = glm::cross(pixel.right, pixel.forward);
  std::optional<Probe> nearest;
  double least = std::numeric_limits<double>::infinity();
  for (const Slice& slice : view.slices) {
    const double depth = -slice.plane.distance(ray.origin) / glm::dot(slice.plane.normal, ray.direction);
    const dvec3 position = ray.origin + depth * ray.direction;
    if (!(depth > 0 && depth < least) || !view.clip.contains(position, 1e-6 * depth)) continue;
    const double value = slice_values(sliced, units, pixel, slice.plane, std::span(&depth, 1)).front();
    if (std::isnan(value)) continue;
    least = depth;
    nearest = Probe{value, position, slice.opacity, {}};
  }
  return nearest;
}

}  // namespace splatvol
