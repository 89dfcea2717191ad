// Undo and redo.
#include "player/history.h"

#include <gtest/gtest.h>

namespace splatvol {
namespace {

TEST(History, GoesBackAndForth) {
  History<int> history(1);
  EXPECT_FALSE(history.can_undo());
  EXPECT_FALSE(history.can_redo());
  EXPECT_EQ(history.undo(), 1);
  EXPECT_EQ(history.redo(), 1);
  history.add(2);
  history.add(2);
  history.add(3);
  EXPECT_EQ(history.undo(), 2);
  EXPECT_EQ(history.undo(), 1) << "a state that was added twice is one";
  EXPECT_FALSE(history.can_undo());
  EXPECT_EQ(history.redo(), 2);
  EXPECT_EQ(history.redo(), 3);
  EXPECT_FALSE(history.can_redo());
  EXPECT_EQ(history.redo(), 3);
}

TEST(History, AChangeForgetsWhatWasUndone) {
  History<int> history(1);
  history.add(2);
  history.add(3);
  history.undo();
  history.add(2);
  EXPECT_TRUE(history.can_redo()) << "the present state is no change";
  history.add(4);
  EXPECT_FALSE(history.can_redo());
  EXPECT_EQ(history.undo(), 2);
  EXPECT_EQ(history.redo(), 4);
}

TEST(History, KeepsTheNewestStates) {
  History<std::size_t> history(0);
  constexpr std::size_t last = 3 * History<int>::most_states;
  for (std::size_t i = 1; i <= last; ++i) history.add(i);
  std::size_t undone = 0;
  for (; history.can_undo(); ++undone) EXPECT_EQ(history.undo(), last - undone - 1);
  EXPECT_EQ(undone, History<int>::most_states - 1);
}

}  // namespace
}  // namespace splatvol
