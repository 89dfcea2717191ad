#include "splatvol/file.h"

#include <algorithm>
#include <cmath>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>

#include "base/addresses.h"
#include "base/interruption.h"
#include "extractor/cell_extraction.h"
#include "extractor/contour_extraction.h"
#include "format/mesh_box.h"
#include "format/splat_reader.h"
#include "format/steps.h"
#include "sampler/cell_line.h"
#include "sampler/cell_sampler.h"
#include "sampler/cell_tetrahedra.h"
#include "sampler/integrals.h"
#include "sampler/splat_sampler.h"
#include "sampler/streamlines.h"
#include "sampler/surface_integrals.h"

namespace splatvol {
namespace {

std::vector<Attribute> attributes_of(const format::VolumeInfo& info) {
  std::vector<Attribute> attributes;
  const auto add = [&](const std::string& name, const format::Attribute& stored) {
    attributes.push_back({name, stored.unit, stored.min, stored.max, stored.missing, stored.error});
  };
  for (const format::Attribute& stored : info.attributes) add(stored.name, stored);
  for (const format::Alias& alias : info.aliases)
    add(alias.name, info.attributes[static_cast<std::size_t>(alias.attribute)]);
  return attributes;
}

// Of parts of the file that were read.
constexpr std::uint64_t held_bytes = std::uint64_t{128} << 20;

bool contains(const Box& box, const dvec3& p) {
  return glm::all(glm::lessThanEqual(box.low, p)) && glm::all(glm::lessThanEqual(p, box.high));
}

std::array<double, 6> covariance_of(const SplatShape& shape) {
  const dmat3 axes = glm::mat3_cast(shape.orientation);
  dmat3 sum(0);
  for (int k = 0; k < 3; ++k) sum += shape.deviations[k] * shape.deviations[k] * glm::outerProduct(axes[k], axes[k]);
  return {sum[0][0], sum[1][1], sum[2][2], sum[0][1], sum[1][2], sum[0][2]};
}

// Appends some points of a group: those of `kept`.
void append(const format::SplatGroup& group, const std::vector<std::size_t>& kept,
            const std::vector<format::Attribute>& stored, const format::SplatSelection& selection, bool material,
            Points& points) {
  for (const std::size_t i : kept) {
    points.positions.push_back(group.positions[i]);
    if (!material) continue;
    points.volumes.push_back(group.shapes[i].mass);
    points.centroids.push_back(group.centroids[i]);
    points.covariances.push_back(covariance_of(group.shapes[i]));
  }
  for (std::size_t a = 0; a < selection.attributes.size(); ++a) {
    const format::Attribute& attribute = stored[selection.attributes[a]];
    for (const std::size_t i : kept) {
      points.values[a].push_back(attribute.value(static_cast<double>(group.values[a][i])));
      if (!material) continue;
      const SplatValue& value = group.materials[a][i];
      constexpr double none = std::numeric_limits<double>::quiet_NaN();
      points.means[a].push_back(value.coverage > 0 ? attribute.value(value.mean) : none);
      points.deviations[a].push_back(value.coverage > 0 ? attribute.scale * value.deviation : none);
    }
  }
}

}  // namespace

struct File::Contents {
  format::Steps steps;
  std::size_t step = 0;
  std::shared_ptr<const format::Volume> volume = nullptr;
  std::vector<Attribute> attributes = {};
  std::mutex mutex = {};
  std::optional<Box> bounds = {};  // once they are asked for

  Status show(std::size_t number) {
    SPLATVOL_TRY_SET(volume, steps.volume(number));
    step = number;
    if (steps.are_files()) bounds.reset();  // each may have a mesh of its own
    attributes = attributes_of(volume->info());
    return {};
  }
};

File::File(std::unique_ptr<Contents> contents) : contents_(std::move(contents)) {}
File::File(File&&) noexcept = default;
File& File::operator=(File&&) noexcept = default;
File::~File() = default;

Result<File> File::open(const std::string& path) {
  SPLATVOL_TRY_ASSIGN(steps, format::Steps::open(path, open_file_or_url));
  auto contents = std::unique_ptr<Contents>(new Contents{std::move(steps)});
  SPLATVOL_TRY(contents->show(contents->steps.last()));
  return File(std::move(contents));
}

const std::string& File::name() const { return contents_->steps.name(); }
const std::vector<Attribute>& File::attributes() const { return contents_->attributes; }
const std::vector<std::uint64_t>& File::resolution_counts() const {
  return contents_->volume->info().resolution_counts;
}
Box File::bounds() const {
  const std::lock_guard lock(contents_->mutex);
  if (!contents_->bounds) {
    const Cube& cube = contents_->volume->info().cube;
    contents_->bounds = format::mesh_box(*contents_->volume).value_or(Box{cube.origin, cube.origin + cube.edge});
  }
  return *contents_->bounds;
}
const std::vector<double>& File::times() const { return contents_->steps.times(); }
std::size_t File::step() const { return contents_->step; }
std::size_t File::nearest_step(double time) const { return contents_->steps.nearest(time); }
std::pair<double, double> File::range_of(const std::string& attribute) const {
  const format::VolumeInfo& info = contents_->volume->info();
  const auto alias = std::ranges::find(info.aliases, attribute, &format::Alias::name);
  const format::StepRange range = contents_->steps.range_of(
      alias == info.aliases.end() ? attribute : info.attributes[static_cast<std::size_t>(alias->attribute)].name);
  return {range.min, range.max};
}
std::uint64_t File::file_bytes() const { return contents_->volume->file_bytes(); }
std::uint64_t File::bytes_read() const { return contents_->volume->bytes_read(); }

Status File::show_step(std::size_t step) {
  if (step > contents_->steps.last())
    return fail(ErrorCode::invalid_argument, "{}: no step {}; the last is {}", name(), step, contents_->steps.last());
  return contents_->show(step);
}

Result<Points> File::points(const PointsRequest& request) const {
  const format::Volume& volume = *contents_->volume;
  const std::size_t resolution = request.resolution.value_or(volume.info().finest_within(request.max_points));
  const Box box = request.box.value_or(format::SplatSelection().box);
  SPLATVOL_TRY_ASSIGN(selection, format::select_splats(volume, resolution, request.attributes, box));
  Points points;
  points.resolution = resolution;
  points.names = selection.names;
  points.values.resize(selection.names.size());
  if (request.material) points.means = points.deviations = points.values;

  const format::SplatReader reader(volume, selection, own_room(format::splat_reader_bytes));
  for (std::uint64_t g = 0; g < reader.group_count(); ++g) {
    SPLATVOL_TRY(check_interruption());
    SPLATVOL_TRY_ASSIGN(group, reader.read(g, {.positions = true}));
    std::vector<std::size_t> kept;
    for (std::size_t i = 0; i < group.size(); ++i)
      if (contains(box, group.positions[i])) kept.push_back(i);
    if (kept.empty()) continue;
    SPLATVOL_TRY_ASSIGN(rest, reader.read(g, {.values = true, .material = request.material}));
    rest.positions = std::move(group.positions);
    append(rest, kept, volume.info().attributes, selection, request.material, points);
  }
  return points;
}

Result<std::vector<double>> File::sample(std::span<const dvec3> positions, const std::string& attribute,
                                         std::optional<std::size_t> resolution) const {
  if (positions.size() >= std::numeric_limits<std::uint32_t>::max())
    return fail(ErrorCode::invalid_argument, "{}: {} positions; at most 2^32 - 2 at once", name(), positions.size());
  const format::Volume& volume = *contents_->volume;
  if (!resolution) {
    SPLATVOL_TRY_ASSIGN(number, format::find_attribute(volume.info(), attribute, name()));
    SPLATVOL_TRY_ASSIGN(cells, CellTetrahedra::open(volume, {static_cast<std::size_t>(number)}, own_room(held_bytes)));
    if (cells && cells->unknown_cells() == 0) return sample_cells(*cells, positions);
  }
  SPLATVOL_TRY_ASSIGN(selection, format::select_splats(volume, resolution, {attribute}, format::SplatSelection().box));
  SplatSampler sampler(positions);
  const format::SplatReader reader(volume, selection, own_room(format::splat_reader_bytes));
  for (std::uint64_t g = 0; g < reader.group_count(); ++g) {
    SPLATVOL_TRY(check_interruption());
    SPLATVOL_TRY_ASSIGN(group, reader.read(g, {.material = true}));
    sampler.add(group);
  }
  std::vector<double> values = sampler.values();
  const format::Attribute& stored = volume.info().attributes[selection.attributes[0]];
  for (double& value : values) value = stored.value(value);
  return values;
}

Result<LineSamples> File::sample_line(const dvec3& start, const dvec3& end, const std::vector<std::string>& attributes,
                                      std::optional<std::size_t> samples) const {
  if (samples && *samples < 2) return fail(ErrorCode::invalid_argument, "{}: a line has two samples or more", name());
  const format::Volume& volume = *contents_->volume;
  SPLATVOL_TRY_ASSIGN(selection, format::select_splats(volume, {}, attributes, format::SplatSelection().box));
  SPLATVOL_TRY_ASSIGN(cells, CellTetrahedra::open(volume, selection.attributes, own_room(held_bytes)));
  if (!cells) return fail_without_cells(volume);
  SPLATVOL_TRY_ASSIGN(rows, follow_line(*cells, start, end));
  if (samples) rows = in_equal_steps(rows, start, end, *samples);
  return LineSamples{std::move(selection.names), std::move(rows.arc_lengths), std::move(rows.positions),
                     std::move(rows.values)};
}

Result<CellMesh> File::cells(const MeshRequest& request) const {
  const format::Volume& volume = *contents_->volume;
  const Box box = request.box.value_or(format::SplatSelection().box);
  SPLATVOL_TRY_ASSIGN(selection, format::select_splats(volume, {}, request.attributes, box));
  return extract_cells(volume, selection);
}

Result<ContourMesh> File::contour(double value, const std::string& attribute, const MeshRequest& request) const {
  if (!std::isfinite(value)) return fail(ErrorCode::invalid_argument, "{}: {} is no value of a contour", name(), value);
  const format::Volume& volume = *contents_->volume;
  const Box box = request.box.value_or(format::SplatSelection().box);
  SPLATVOL_TRY_ASSIGN(others, format::select_splats(volume, {}, request.attributes, box));
  SPLATVOL_TRY_ASSIGN(selection, format::select_splats(volume, {}, {attribute}, box));
  for (std::size_t i = 0; i < others.names.size(); ++i)
    if (others.names[i] != attribute) selection.add(others.attributes[i], others.names[i]);
  return extract_contour(volume, selection, value);
}

Result<Integrals> File::integrate(const IntegralRequest& request) const {
  const std::size_t threads = std::max(1u, std::thread::hardware_concurrency());
  return integrate_cells(*contents_->volume, request, held_bytes, threads, [](double) {});
}

Result<SurfaceIntegrals> File::integrate_surface(const SurfaceRequest& request) const {
  const std::size_t threads = std::max(1u, std::thread::hardware_concurrency());
  return splatvol::integrate_surface(*contents_->volume, request, held_bytes, threads, [](double) {});
}

Result<Streamlines> File::streamlines(const StreamlineRequest& request) const {
  const std::size_t threads = std::max(1u, std::thread::hardware_concurrency());
  return find_streamlines(*contents_->volume, request, usual_streamline_bytes, threads);
}

Status File::verify(const std::function<void(double)>& progress) const {
  return contents_->steps.verify(progress ? progress : [](double) {});
}

}  // namespace splatvol
