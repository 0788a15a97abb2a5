"""Lock, guardian, fence: nobody leaves a chamber alone."""
