#include "builder/cells/step_summaries.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <vector>

#include "base/interruption.h"
#include "format/ranked_points.h"

namespace splatvol {
namespace {

// Summarizes chunks. Each thread has one.
class ChunkSummarizer {
 public:
  ChunkSummarizer(const format::CellReader& cells, const format::RankedPoints& points)
      : cells_(cells), points_(points) {}

  // Sets summaries[attribute][chunk].
  Status run(const format::CellChunkEntry& entry, std::size_t chunk, std::span<const format::ValueBins> bins,
             std::vector<std::vector<format::ValueSummary>>& summaries) {
    SPLATVOL_TRY_ASSIGN(cells, cells_.read_chunk(entry));
    const bool is_constant = entry.field == format::CellField::constant;
    const format::LocalCells local = format::number_corners(cells.corners);
    SPLATVOL_TRY(points_.find(is_constant ? cells.points : local.ranks, places_));
    for (std::size_t a = 0; a < bins.size(); ++a) {
      SPLATVOL_TRY(points_.read_values(places_, static_cast<int>(a), values_));
      summaries[a][chunk] =
          is_constant ? bins[a].summarize(values_) : format::summarize_cells(cells, local, values_, bins[a]);
    }
    return {};
  }

 private:
  const format::CellReader& cells_;
  const format::RankedPoints& points_;
  std::vector<format::RankedPoints::Place> places_;
  std::vector<float> values_;
};

}  // namespace

Status write_step_summaries(const format::CellReader& cells, const std::shared_ptr<const format::ChunkSource>& values,
                            std::span<const format::Attribute> attributes, std::uint64_t memory,
                            const std::function<Status(std::span<const std::byte>)>& append) {
  std::vector<format::ValueBins> bins;
  for (const format::Attribute& attribute : attributes) bins.push_back(format::bins_of(attribute));
  const format::RankedPoints points(
      values, [&](std::size_t page) { return cells.read_rank_page(page); }, own_room(memory));
  tbb::enumerable_thread_specific<ChunkSummarizer> summarizers([&] { return ChunkSummarizer(cells, points); });
  format::Bytes refs;
  std::uint64_t offset = 0;
  for (std::size_t number = 0; number < cells.pages().size(); ++number) {
    SPLATVOL_TRY(check_interruption());
    SPLATVOL_TRY_ASSIGN(page, cells.read_page(number, {}));
    std::vector<std::vector<format::ValueSummary>> summaries(bins.size(),
                                                             std::vector<format::ValueSummary>(page.chunks.size()));
    std::vector<Status> results(page.chunks.size());
    tbb::parallel_for(std::size_t{0}, page.chunks.size(), [&](std::size_t chunk) {
      results[chunk] = summarizers.local().run(page.chunks[chunk], chunk, bins, summaries);
    });
    for (const Status& result : results) SPLATVOL_TRY(result);
    format::Bytes table, parts;
    for (const std::vector<format::ValueSummary>& of_attribute : summaries)
      format::append_part(table, parts, format::pack_summaries(of_attribute));
    format::append_record(
        refs, format::SummaryPageRef{offset, static_cast<std::uint32_t>(table.size() + parts.size()),
                                     static_cast<std::uint32_t>(page.chunks.size()), format::hash_bytes(table)});
    SPLATVOL_TRY(append(table));
    SPLATVOL_TRY(append(parts));
    offset += table.size() + parts.size();
  }
  format::append_record(refs, format::hash_bytes(refs));
  return append(refs);
}

}  // namespace splatvol
