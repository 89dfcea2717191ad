// OpenVDB, as its readers need it.
#pragma once

namespace splatvol {

/// Registers OpenVDB's types and turns its log off: errors come as exceptions. OpenVDB then refuses a block of
/// compressed values whose length does not fit; on its own, it would write past its memory. Returns false if OpenVDB
/// does without that check, because the program loaded it before this code. Safe in several threads.
bool start_vdb();

}  // namespace splatvol
