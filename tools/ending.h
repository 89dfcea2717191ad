// Ends that a program does not choose: signals, and memory or threads that the system refuses.
#pragma once

#include <string_view>

namespace splatvol {

/// Removes temporary files (base/temporary_names.h) before a signal ends the process, then lets it. Leaves signals
/// alone that are ignored or have a handler.
void clean_up_at_signals();

/// Prints "NAME: MESSAGE" to stderr. Takes no memory.
void say(std::string_view name, std::string_view message) noexcept;

}  // namespace splatvol
