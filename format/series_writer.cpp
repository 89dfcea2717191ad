#include "format/series_writer.h"

#include <algorithm>
#include <limits>

#include "base/append_file.h"
#include "format/container.h"
#include "format/series_index.h"

namespace splatvol::format {
namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

// Writes steps behind the end of a file with this superblock and section table. Returns the superblock that makes them
// its steps, once the disk has all that it needs.
Result<Superblock> append_behind(AppendFile& file, const Volume& volume, Bytes table,
                                 std::span<const std::unique_ptr<StepWriter>> steps) {
  const StepEntry& last = volume.series()->entries.back();
  Bytes replaced(static_cast<std::size_t>(volume.file_bytes() - (last.offset + last.bytes)));
  SPLATVOL_TRY(file.read(last.offset + last.bytes, replaced));
  SPLATVOL_TRY(file.cut(volume.file_bytes()));
  StepDirectory directory(volume, hash_bytes(replaced));
  for (const std::unique_ptr<StepWriter>& step : steps)
    SPLATVOL_TRY(directory.write(*step, [&](std::span<const std::byte> bytes) { return file.append(bytes); }));
  const Bytes packed = directory.pack();
  SPLATVOL_TRY(file.append(packed));

  auto superblock = read_record<Superblock>(table, 0);
  superblock.step_directory = directory.end();
  superblock.file_bytes = directory.end() + packed.size() + sizeof(Footer);
  seal(superblock);
  std::ranges::copy(std::as_bytes(std::span(&superblock, 1)), table.begin());
  const Footer footer = make_footer(superblock.file_bytes, hash_bytes(table));
  SPLATVOL_TRY(file.append(std::as_bytes(std::span(&footer, 1))));
  SPLATVOL_TRY(file.sync());
  return superblock;
}

// Makes what stands behind the file a part of it. Whatever fails here, the file may need these bytes: they stay.
Status replace_superblock(AppendFile& file, const Superblock& superblock) {
  const Status replaced = file.replace_front(std::as_bytes(std::span(&superblock, 1)));
  if (!replaced)
    return fail(ErrorCode::io, "{}; svinfo tells whether the file has the steps", replaced.error().message);
  const Status synced = file.sync();
  if (synced) return {};
  return fail(
      ErrorCode::io,
      "{}; the steps are in the file, though the disk has not confirmed it: check it by svinfo --verify, and do "
      "not append them again",
      synced.error().message);
}

// Reads the superblock and section table that a file has now.
Result<Bytes> read_table(const AppendFile& file, const Volume& volume) {
  Bytes table(sizeof(Superblock) + volume.sections().size() * sizeof(SectionEntry));
  SPLATVOL_TRY(file.read(0, table));
  return table;
}

}  // namespace

StepDirectory::StepDirectory(std::size_t attributes, std::uint64_t offset)
    : ranges_(attributes, StepRange{nan, nan}), end_(offset) {}

StepDirectory::StepDirectory(const Volume& volume, std::uint64_t hash)
    : entries_(volume.series()->entries), ranges_(volume.series()->ranges), end_(volume.file_bytes()) {
  const std::uint64_t steps_end = entries_.back().offset + entries_.back().bytes;
  entries_.push_back({0, steps_end, end_ - steps_end, hash, StepEntryKind::dead, 0});
}

Status StepDirectory::write(StepWriter& step, const StepWriter::Append& append) {
  const auto last = std::find_if(entries_.rbegin(), entries_.rend(),
                                 [](const StepEntry& entry) { return entry.kind == StepEntryKind::step; });
  if (last != entries_.rend() && !(step.step().time > last->time))
    return fail(ErrorCode::invalid_data, "the time {} is not behind {}, the time of the step before", step.step().time,
                last->time);
  if (entries_.size() >= max_step_entries)
    return fail(ErrorCode::unsupported, "a time series has at most {} steps and appends", max_step_entries);
  SPLATVOL_TRY_ASSIGN(entry, step.write(end_, append));
  entries_.push_back(entry);
  end_ += entry.bytes;
  for (std::size_t a = 0; a < ranges_.size(); ++a) {
    const Attribute& attribute = step.step().attributes[a];
    include(ranges_[a], attribute.min, attribute.max);
  }
  return {};
}

Bytes StepDirectory::pack() const {
  StepDirectoryHead head{0, entries_.size(), ranges_.size()};
  Bytes bytes;
  append_record(bytes, head);
  for (const StepEntry& entry : entries_) append_record(bytes, entry);
  for (const StepRange& range : ranges_) append_record(bytes, range);
  head.hash = hash_bytes(std::span(bytes).subspan(sizeof(head.hash)));
  std::ranges::copy(std::as_bytes(std::span(&head, 1)), bytes.begin());
  return bytes;
}

Footer make_footer(std::uint64_t file_bytes, std::uint64_t table_hash) {
  Footer footer{};
  std::ranges::copy(footer_magic, footer.magic);
  footer.file_bytes = file_bytes;
  footer.table_hash = table_hash;
  footer.hash = hash_bytes(std::as_bytes(std::span(&footer, 1)).first(offsetof(Footer, hash)));
  return footer;
}

Result<Appended> append_steps(const std::string& path, const Volume& volume,
                              std::span<const std::unique_ptr<StepWriter>> steps) {
  if (!volume.series()) return fail(ErrorCode::invalid_argument, "{}: not a time series", path);
  SPLATVOL_TRY_ASSIGN(file, AppendFile::open(path));
  SPLATVOL_TRY_ASSIGN(table, read_table(file, volume));
  if (hash_bytes(table) != volume.table_hash())
    return fail(ErrorCode::io, "{}: was changed meanwhile; try again", path);
  const auto superblock = append_behind(file, volume, std::move(table), steps);
  if (!superblock) {
    static_cast<void>(file.cut(volume.file_bytes()));
    return tl::unexpected(superblock.error());
  }
  SPLATVOL_TRY(replace_superblock(file, *superblock));
  return Appended{superblock->file_bytes, file.is_locked()};
}

}  // namespace splatvol::format
