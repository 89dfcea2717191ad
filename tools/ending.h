// Ends that a program does not choose: signals, and memory or threads that the system refuses.
#pragma once

#include <string_view>

namespace splatvol {

/// Removes temporary files (base/temporary_names.h) before a signal ends the process, then lets it. Leaves signals
/// alone that are ignored or have a handler.
void clean_up_at_signals();

/// Lets SIGINT print a line to stdout before it ends the process; null: it prints none. The text must stay.
void say_when_interrupted(const char* line);

/// Lets the process end by SIGTERM when the process that started it has ended, however that ends.
void end_with_parent();

/// Prints "NAME: MESSAGE" to stderr. Takes no memory.
void say(std::string_view name, std::string_view message) noexcept;

}  // namespace splatvol
