#include "streamer/cells/file_cells.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/matrix.hpp>
#include <glm/vector_relational.hpp>
#include <iterator>
#include <limits>
#include <optional>
#include <unordered_set>
#include <utility>

#include "base/interruption.h"
#include "format/part_kinds.h"
#include "scene/box_in_view.h"
#include "scene/clipped_depths.h"
#include "streamer/splats/frustum.h"
#include "streamer/splats/visibility.h"

namespace splatvol {
namespace {

// Tetrahedra of a cell; about.
std::size_t tetrahedra_of(format::CellShape shape) {
  switch (shape) {
    case format::CellShape::tetrahedron:
      return 1;
    case format::CellShape::pyramid:
      return 2;
    case format::CellShape::wedge:
      return 3;
    case format::CellShape::hexahedron:
      return 6;
    case format::CellShape::polyhedron:
      return 20;  // most have some 14 corners
  }
  return 1;
}

// A rectangle of the picture, in pixels.
struct Rectangle {
  dvec2 low, high;
};

// Where a box is in the picture, or all of the picture if the box reaches the eye's plane.
Rectangle rectangle_of(const Box& box, const View& view) {
  const dvec2 size(view.width, view.height);
  Rectangle rectangle{size, dvec2(0)};
  for (const dvec3& at : corners_in_view(view, box)) {
    if (!view.orthographic && !(at.z > 0)) return {dvec2(0), size};
    const dvec2 pixel = dvec2(at) * (view.orthographic ? view.focal : view.focal / at.z) + 0.5 * size;
    rectangle.low = glm::min(rectangle.low, pixel);
    rectangle.high = glm::max(rectangle.high, pixel);
  }
  return {glm::clamp(rectangle.low, dvec2(0), size), glm::clamp(rectangle.high, dvec2(0), size)};
}

// How many faces all pixels' rays meet in a box that has an area of 2 in each unit of volume. For normals n of faces,
// the mean of |n v| is 1/2 if they have all directions v, and the root of a mean square is about proportional to it.
double faces_on_rays(const Box& box, const dmat3& normals, const View& view) {
  constexpr int samples = 4;  // along each side of the rectangle
  View in_box = view;
  if (const std::optional<Box>& clip = view.clip.box)
    in_box.clip.box = {glm::max(box.low, clip->low), glm::min(box.high, clip->high)};
  else
    in_box.clip.box = box;
  if (glm::any(glm::greaterThan(in_box.clip.box->low, in_box.clip.box->high))) return 0;
  const Rectangle rectangle = rectangle_of(box, view);
  const dvec2 step = (rectangle.high - rectangle.low) / double{samples};
  double sum = 0;
  for (int sample = 0; sample < samples * samples; ++sample) {
    const dvec2 pixel = rectangle.low + step * (dvec2(sample % samples, sample / samples) + 0.5);
    const dvec2 at = (pixel - 0.5 * dvec2(view.width, view.height)) / view.focal;
    const VisibleDepths inside = clipped_depths(in_box, at.x, at.y);
    if (!(inside.from < inside.to)) continue;
    const dvec3 ray = view.orthographic ? view.forward : view.forward + at.x * view.right + at.y * view.up;
    sum += (inside.to - inside.from) * std::sqrt(3 * std::max(glm::dot(ray, normals * ray), 0.0));
  }
  return sum * step.x * step.y;
}

// Looks at some of many cells.
ShownFaces shown_faces_of(const Tetrahedra& cells, const ShownInCells& shown) {
  constexpr std::size_t looked_at = 256;
  // Whether the values of a tetrahedron are visible, none of which may be missing.
  const auto shows = [&](std::size_t number, const std::vector<double>& values, const auto& is_visible) {
    double low = std::numeric_limits<double>::infinity(), high = -low;
    for (const std::uint32_t corner : cells.corners[number]) {
      const double value = values[cells.constant ? number : corner];
      if (std::isnan(value)) return false;
      low = std::min(low, value), high = std::max(high, value);
    }
    return is_visible(low, high);
  };
  const auto by = [](const TransferFunction& function) {
    return [&function](double low, double high) { return extinction_within(function, low, high); };
  };
  double all = 0, seen = 0;
  dmat3 normals(0);
  const std::size_t step = 1 + cells.size() / looked_at;
  for (std::size_t number = 0; number < cells.size(); number += step) {
    const auto& [a, b, c, d] = cells.corners[number];
    const dvec3 p = cells.points[a], q = cells.points[b] - p, r = cells.points[c] - p, s = cells.points[d] - p;
    const std::array<dvec3, 4> faces = {glm::cross(q, r), glm::cross(q, s), glm::cross(r, s),
                                        glm::cross(r - q, s - q)};  // normals, as long as their areas
    for (const dvec3& face : faces) all += glm::length(face);
    const bool has_matter = shows(number, cells.values[0], by(shown.function)) &&
                            (!shown.opacity || shows(number, cells.values[1], by(shown.opacity->function)));
    if (has_matter ||
        shows(number, cells.values[0], [&](double low, double high) { return shown.has_contour(low, high); }))
      for (const dvec3& face : faces) {
        const double area = glm::length(face);
        seen += area;
        if (area > 0) normals += glm::outerProduct(face, face / area);
      }
  }
  return seen > 0 ? ShownFaces{seen / all, normals / seen} : ShownFaces{0};
}

// The bytes of all cells of a file, decoded: about.
std::uint64_t decoded_bytes(const format::CellReader& cells) {
  constexpr std::uint64_t of_tetrahedron = 32;  // with its share of the points
  std::uint64_t tetrahedra = 0;
  for (const format::CellKind& kind : cells.kinds()) tetrahedra += kind.cells * tetrahedra_of(kind.shape);
  return tetrahedra * of_tetrahedron;
}

}  // namespace

ShownInCells::ShownInCells(const Scene& scene) : function(scene.transfer_function), opacity(scene.opacity) {
  for (const Contour& contour : contours_of(scene).surfaces) contours.push_back(contour.value);
}

bool ShownInCells::has_contour(double low, double high) const {
  const auto above = std::ranges::lower_bound(contours, low);
  return above != contours.end() && *above <= high;
}

Result<std::shared_ptr<const KeptCells>> KeptCells::open(const format::Volume& volume, const Scene& scene,
                                                         const PartRoom& room) {
  const format::VolumeInfo& info = volume.info();
  format::SummaryAttributes attributes;
  SPLATVOL_TRY_SET(attributes.values, format::find_attribute(info, scene.attribute, volume.name()));
  if (scene.opacity)
    SPLATVOL_TRY_SET(attributes.opacity, format::find_attribute(info, scene.opacity->attribute, volume.name()));
  std::vector<std::size_t> shown = {static_cast<std::size_t>(attributes.values)};
  if (scene.opacity) shown.push_back(static_cast<std::size_t>(attributes.opacity));
  const Contours contours = contours_of(scene);
  if (!contours.attribute.empty()) {
    SPLATVOL_TRY_ASSIGN(color, format::find_attribute(info, contours.attribute, volume.name()));
    shown.push_back(static_cast<std::size_t>(color));
  }
  SPLATVOL_TRY_ASSIGN(cells, CellTetrahedra::open(volume, std::move(shown), room, attributes));
  if (!cells)
    return fail(ErrorCode::invalid_argument,
                "{}: it keeps no cells, and only these are drawn exactly: build it from a mesh, or from points by "
                "--connectivity delaunay, without --drop-cells",
                volume.name());
  const auto is_constant = [](const format::CellKind& kind) { return kind.field == format::CellField::constant; };
  if (!contours.surfaces.empty() && std::ranges::all_of(cells->reader().kinds(), is_constant))
    return fail(ErrorCode::invalid_argument,
                "{}: contours: each cell has one value, and so nothing passes another: build it without --cells own",
                volume.name());
  return std::shared_ptr<const KeptCells>(new KeptCells(std::move(cells), contours.attribute, room));
}

// Points take less memory than the cells, so a third of the share is enough for them.
KeptCells::KeptCells(std::unique_ptr<const CellTetrahedra> cells, std::string color_name, const PartRoom& room)
    : cells_(std::move(cells)),
      color_name_(std::move(color_name)),
      room_(room),
      holds_all_(decoded_bytes(cells_->reader()) <= room_.share->capacity() / 3 * 2),
      gradients_(*cells_, room_,
                 [this](const format::CellChunkEntry& entry, Tetrahedra& scratch) { return read(entry, scratch); }) {}

PartKey KeptCells::key_of(const format::CellChunkEntry& entry) const {
  const int color = color_name_.empty() ? -1 : static_cast<int>(cells_->attributes().back());
  const auto [values, opacity] = cells_->summaries();
  const std::array of_values{values, opacity, color};
  return {room_.file, format::cell_chunk, entry.offset, format::columns_key(of_values), reader().volume().step_key()};
}

Result<const Tetrahedra*> KeptCells::read(const format::CellChunkEntry& entry, Tetrahedra& scratch) const {
  if (!holds_all_) {
    SPLATVOL_TRY_SET(scratch, decode(entry));
    return &scratch;
  }
  {
    const std::scoped_lock lock(held_mutex_);
    if (const auto held = chunks_.find(entry.offset); held != chunks_.end()) return held->second.get();
  }
  SPLATVOL_TRY_ASSIGN(cells, room_.table->get<Tetrahedra>(
                                 key_of(entry), *room_.share, 0, [&] { return decode(entry); },
                                 [](const Tetrahedra& decoded) { return decoded.memory_bytes(); }));
  if (!room_.table->holds(key_of(entry))) {  // it takes more than it was thought to
    scratch = *cells;
    return &scratch;
  }
  const std::scoped_lock lock(held_mutex_);
  return chunks_.try_emplace(entry.offset, std::move(cells)).first->second.get();
}

Result<ShownFaces> KeptCells::shown_faces(const format::CellChunkEntry& entry, const ShownInCells& shown) const {
  const std::scoped_lock lock(faces_mutex_);
  if (faces_of_ != shown) {
    faces_of_ = shown;
    faces_.clear();
  }
  const auto known = faces_.find(entry.offset);
  if (known != faces_.end()) return known->second;
  Tetrahedra scratch;
  SPLATVOL_TRY_ASSIGN(cells, read(entry, scratch));
  const ShownFaces faces = shown_faces_of(*cells, shown);
  faces_.emplace(entry.offset, faces);
  return faces;
}

bool KeptCells::holds(const format::CellChunkEntry& entry) const {
  const std::scoped_lock lock(held_mutex_);
  return chunks_.contains(entry.offset);
}

Status KeptCells::hold_all() const {
  if (!holds_all_ || are_held_) return {};
  Tetrahedra scratch;
  std::size_t known = 0;
  std::vector<std::shared_ptr<const format::CellPage>> pages;
  for (std::size_t number = 0; number < reader().pages().size(); ++number) {
    SPLATVOL_TRY_ASSIGN(page, cells_->read_page(number));
    pages.push_back(page);
    SPLATVOL_TRY_ASSIGN(ahead, read_ahead(page->chunks));
    for (const format::CellChunkEntry& entry : page->chunks) {
      SPLATVOL_TRY(check_interruption());
      if (!format::is_known(entry.shape, entry.field)) continue;
      SPLATVOL_TRY(read(entry, scratch));
      ++known;
    }
  }
  const std::scoped_lock lock(held_mutex_);
  pages_ = std::move(pages);
  are_held_ = chunks_.size() == known;
  return {};
}

Result<Tetrahedra> KeptCells::decode(const format::CellChunkEntry& entry) const {
  SPLATVOL_TRY_ASSIGN(cells, cells_->read(entry));
  cells.cells = std::vector<std::uint32_t>();  // drawing needs no names of cells
  return cells;
}

Result<format::CellsAhead> KeptCells::read_ahead(std::span<const format::CellChunkEntry> entries) const {
  if (!reader().volume().is_far()) return format::CellsAhead{};
  std::vector<format::CellChunkEntry> missing;
  std::ranges::copy_if(entries, std::back_inserter(missing),
                       [&](const format::CellChunkEntry& entry) { return !room_.table->holds(key_of(entry)); });
  return cells_->read_ahead(missing);
}

Result<format::CellsAhead> KeptCells::read_gradients_ahead(std::span<const format::CellChunkEntry> entries,
                                                           std::span<const double> contours) const {
  if (!reader().volume().is_far() || contours.empty()) return format::CellsAhead{};
  std::unordered_set<std::uint64_t> known;
  for (const format::CellChunkEntry& entry : entries) known.insert(entry.offset);
  std::vector<format::CellChunkEntry> others;
  Tetrahedra scratch;
  for (const format::CellChunkEntry& entry : entries) {
    if (entry.field == format::CellField::constant) continue;
    SPLATVOL_TRY(check_interruption());
    SPLATVOL_TRY_ASSIGN(cells, read(entry, scratch));
    SPLATVOL_TRY_ASSIGN(sources, gradients_.sources_at_contours(entry, *cells, contours));
    for (const format::CellChunkEntry& source : sources)
      if (known.insert(source.offset).second) others.push_back(source);
  }
  return read_ahead(others);
}

Result<std::shared_ptr<const void>> FileCells::read_ahead(std::span<const std::uint64_t> numbers) const {
  std::vector<format::CellChunkEntry> entries;
  for (const std::uint64_t number : numbers) entries.push_back(entries_[static_cast<std::size_t>(number)]);
  SPLATVOL_TRY_ASSIGN(ahead, kept_->read_ahead(entries));
  SPLATVOL_TRY_ASSIGN(more, kept_->read_gradients_ahead(entries, shown_.contours));
  ahead.insert(ahead.end(), more.begin(), more.end());
  return std::make_shared<const format::CellsAhead>(std::move(ahead));
}

Result<std::unique_ptr<const FileCells>> FileCells::open(std::shared_ptr<const KeptCells> kept, const Scene& scene,
                                                         const View& view) {
  std::unique_ptr<FileCells> cells(new FileCells(std::move(kept), scene, view));
  SPLATVOL_TRY(cells->read_entries());
  return cells;
}

Status FileCells::read_entries() {
  const format::SummaryAttributes& attributes = kept_->cells().summaries();
  const std::vector<format::Attribute>& all = kept_->reader().volume().info().attributes;
  const format::Attribute* const opacity =
      attributes.opacity < 0 ? nullptr : &all[static_cast<std::size_t>(attributes.opacity)];
  const Transfer transfer(shown_.function, shown_.opacity ? &shown_.opacity->function : nullptr);
  const ValueVisibility visibility(transfer, {all[static_cast<std::size_t>(attributes.values)], opacity});
  const auto shows = [&](const format::CellPage& page, std::size_t chunk) {
    const format::ValueSummary& values = page.summaries[chunk];
    return visibility.shows({values, opacity ? &page.opacity_summaries[chunk] : nullptr}) ||
           may_meet_event(box_of_cells(page.chunks[chunk]), values);
  };
  const Frustum frustum(view_, 0);
  SPLATVOL_TRY_SET(entries_, kept_->cells().chunks([&](const Box& box) { return frustum.touches(box); }, shows));
  for (const format::CellChunkEntry& entry : entries_) {
    const std::size_t tetrahedra = entry.cells * tetrahedra_of(entry.shape);
    chunks_.push_back({box_of_cells(entry), static_cast<std::uint32_t>(tetrahedra), chunks_.size()});
  }
  return {};
}

// Whether rays may meet a contour or a slice in a chunk. Missing values have an empty range.
bool FileCells::may_meet_event(const Box& box, const format::ValueSummary& values) const {
  if (!(values.min <= values.max)) return false;
  const auto number = static_cast<std::size_t>(kept_->cells().summaries().values);
  const format::Attribute& attribute = kept_->reader().volume().info().attributes[number];
  if (shown_.has_contour(attribute.value(double{values.min}), attribute.value(double{values.max}))) return true;
  const dvec3 middle = 0.5 * (box.low + box.high), half = 0.5 * box.extent();
  return std::ranges::any_of(view_.slices, [&](const Slice& slice) {
    const double reach = glm::dot(glm::abs(slice.plane.normal), half);
    return std::abs(slice.plane.distance(middle)) <= reach + 1e-9 * glm::length(half);
  });
}

std::uint64_t FileCells::tetrahedra() const {
  std::uint64_t tetrahedra = 0;
  for (const Chunk& chunk : chunks_) tetrahedra += chunk.tetrahedra;
  return tetrahedra;
}

std::uint64_t FileCells::unread_tetrahedra() const {
  if (kept_->are_held()) return 0;
  std::uint64_t tetrahedra = 0;
  for (const Chunk& chunk : chunks_)
    if (!kept_->holds(entries_[static_cast<std::size_t>(chunk.number)])) tetrahedra += chunk.tetrahedra;
  return tetrahedra;
}

// A ray enters and leaves by a face.
double FileCells::segments_of(const Chunk& chunk, const ShownFaces& faces) const {
  const dvec3 extent = chunk.box.extent();
  const double least = 1e-6 * std::max({extent.x, extent.y, extent.z});  // of a flat box
  const dvec3 margin = 0.5 * glm::max(dvec3(least) - extent, dvec3(0));
  const Box box{chunk.box.low - margin, chunk.box.high + margin};
  const dvec3 size = box.extent();
  const double volume = size.x * size.y * size.z;
  const double area = entries_[static_cast<std::size_t>(chunk.number)].area * faces.share;
  return volume > 0 ? area / 4 / volume * faces_on_rays(box, faces.normals, view_) : 0;
}

// Of many chunks, those are read in which equal parts of all segments would have their middles.
Result<double> FileCells::estimate_segments() const {
  const std::size_t most_read = kept_->reader().volume().is_far() ? 16 : 64;
  std::vector<double> end_of(chunks_.size());  // running sums
  double all = 0;
  for (std::size_t i = 0; i < chunks_.size(); ++i) end_of[i] = all += segments_of(chunks_[i], {});
  std::vector<std::pair<std::uint64_t, double>> read;  // numbers of chunks, and the segments that each stands for
  if (chunks_.size() <= most_read)
    for (std::size_t i = 0; i < chunks_.size(); ++i)
      read.emplace_back(chunks_[i].number, end_of[i] - (i > 0 ? end_of[i - 1] : 0));
  else
    for (std::size_t part = 0; part < most_read; ++part) {
      const double middle = all * (static_cast<double>(part) + 0.5) / static_cast<double>(most_read);
      const auto chunk = static_cast<std::size_t>(std::ranges::lower_bound(end_of, middle) - end_of.begin());
      read.emplace_back(chunks_[std::min(chunk, chunks_.size() - 1)].number, all / static_cast<double>(most_read));
    }
  std::vector<format::CellChunkEntry> entries;
  for (const auto& [number, stands_for] : read) entries.push_back(entries_[static_cast<std::size_t>(number)]);
  SPLATVOL_TRY_ASSIGN(ahead, kept_->read_ahead(entries));
  double segments = 0;
  for (const auto& [number, stands_for] : read) {
    SPLATVOL_TRY(check_interruption());
    SPLATVOL_TRY_ASSIGN(faces, kept_->shown_faces(entries_[static_cast<std::size_t>(number)], shown_));
    const Chunk& chunk = chunks_[static_cast<std::size_t>(number)];
    const double of_all = segments_of(chunk, {});
    if (of_all > 0) segments += segments_of(chunk, faces) / of_all * stands_for;
  }
  return segments;
}

}  // namespace splatvol
