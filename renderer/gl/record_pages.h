// Drawing records in the device's memory. Internal to the rasterizer.
#pragma once

#include <algorithm>
#include <cstdint>
#include <memory>
#include <span>
#include <unordered_map>
#include <vector>

#include "base/error.h"
#include "renderer/gl/gl_objects.h"
#include "splat/record.h"

namespace splatvol {

/// Keeps the records of rows in pages: pairs of large buffers, one of shapes and one of values. If all rows have
/// opacity values, these follow the values of all slots. A page consists of
/// slots, each with room for some consecutive records of a row. A record goes up once, and stays until other rows need
/// its slot; the rows that were drawn least recently leave first.
class RecordPages {
 public:
  static constexpr std::uint32_t slot_records = 32;

  /// `page_bytes`: of a page's larger buffer, at most. A page is no larger than the device's shaders can see.
  RecordPages(KernelKind kind, std::uint64_t page_bytes);

  /// Makes the records of all ranges resident, within `budget` bytes. Requires rows of the kernel. Fails with
  /// ErrorCode::out_of_budget if they take more, and with ErrorCode::device if the device has no memory left.
  [[nodiscard]] Status hold(std::span<const DrawRange> ranges, std::uint64_t budget);

  /// Calls visit(page, record in the page, count) for the parts of a range that lie in one slot. Requires a range of
  /// the last `hold`.
  template <class Visit>
  void for_each_part(const DrawRange& range, const Visit& visit) const {
    const HeldRow& row = rows_.at(key_of(range));
    for (std::uint32_t begin = range.begin, end = range.begin + range.count; begin < end;) {
      const std::uint32_t part_end = std::min(end, (begin / slot_records + 1) * slot_records);
      const std::uint32_t slot = row.slots[begin / slot_records];
      visit(slot / slots_per_page_, slot % slots_per_page_ * slot_records + begin % slot_records, part_end - begin);
      begin = part_end;
    }
  }

  [[nodiscard]] std::size_t page_count() const { return pages_.size(); }
  [[nodiscard]] const Buffer& shapes(std::size_t page) const { return pages_[page].shapes; }
  [[nodiscard]] const Buffer& values(std::size_t page) const { return pages_[page].values; }

  /// Returns where a page's buffer of values has the first opacity value, in bytes; 0: it has none.
  [[nodiscard]] std::size_t opacity_offset(std::size_t page) const {
    return opacity_bytes_ > 0 ? values_offset(pages_[page].slots) : 0;
  }
  [[nodiscard]] bool has_opacity() const { return opacity_bytes_ > 0; }

  /// Returns the bytes that were uploaded so far.
  [[nodiscard]] std::uint64_t uploaded_bytes() const { return uploaded_bytes_; }

  /// Returns the bytes of all pages.
  [[nodiscard]] std::uint64_t bytes() const { return std::uint64_t{capacity()} * slot_bytes(); }

 private:
  static constexpr std::uint32_t no_slot = 0xFFFFFFFF;

  struct RowKey {
    std::uint64_t shapes, values;
    [[nodiscard]] bool operator==(const RowKey&) const = default;
  };
  struct RowKeyHash {
    std::size_t operator()(const RowKey& key) const { return key.shapes * 0x9E3779B97F4A7C15U ^ key.values; }
  };
  struct HeldRow {
    std::weak_ptr<const ShapeRow> shapes;
    std::weak_ptr<const ValueRow> values;
    std::vector<std::uint32_t> slots;  // of each slot_records records of the row
    std::uint64_t drawn = 0;           // number of the last list that had it
  };
  struct Page {
    Buffer shapes{"shapes of splats"}, values{"values of splats"};
    std::uint32_t slots = 0;
  };
  struct Missing {
    HeldRow* held;
    const RecordRow* row;
    std::uint32_t index;  // in the row's slots
  };

  static RowKey key_of(const DrawRange& range) { return {range.row.shapes->id(), range.row.values->id()}; }
  [[nodiscard]] std::uint32_t slot_bytes() const {
    return slot_records * (shape_bytes_ + value_bytes_ + opacity_bytes_);
  }
  [[nodiscard]] std::uint32_t largest_bytes() const {  // of a record in one buffer
    return std::max<std::uint32_t>(shape_bytes_, value_bytes_ + sizeof(OpacityValue));
  }
  [[nodiscard]] std::size_t values_offset(std::uint32_t slots) const {
    return std::size_t{slots} * slot_records * value_bytes_;
  }
  [[nodiscard]] std::uint32_t capacity() const;
  [[nodiscard]] std::uint64_t available() const { return free_.size() + capacity() - end_; }
  [[nodiscard]] std::vector<Missing> find_missing(std::span<const DrawRange> ranges);
  [[nodiscard]] Status make_room(std::uint64_t count, std::uint64_t budget);
  [[nodiscard]] Status grow(std::uint64_t count, std::uint64_t budget);
  [[nodiscard]] Status resize(Page& page, std::uint32_t slots);
  void forget_rows();
  void release_dropped();
  void release_least_recent(std::uint64_t count);
  void release(const HeldRow& row);
  [[nodiscard]] std::uint32_t take_slot();
  void upload(std::span<const Missing> missing);
  void write(const Missing& first, std::uint32_t slots);

  const std::uint32_t shape_bytes_, value_bytes_;
  std::uint32_t opacity_bytes_ = 0;  // of a record; 0: there is no opacity
  const std::uint32_t slots_per_page_;
  std::vector<Page> pages_;  // full, but for the last
  std::unordered_map<RowKey, HeldRow, RowKeyHash> rows_;
  std::vector<std::uint32_t> free_;  // descending
  std::uint32_t end_ = 0;            // the first slot that no row has ever had
  std::uint64_t list_ = 0;           // number of the present list
  std::uint64_t uploaded_bytes_ = 0;
};

}  // namespace splatvol
