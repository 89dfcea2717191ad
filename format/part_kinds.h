// Kinds of decoded parts of a file.
#pragma once

namespace splatvol::format {

/// PartKey::kind. The number is that of the page, of the group, or the offset of the chunk.
enum PartKind : int { directory_page, rank_page, vertex_page, group_positions, group_values, cell_page, cell_chunk };

}  // namespace splatvol::format
