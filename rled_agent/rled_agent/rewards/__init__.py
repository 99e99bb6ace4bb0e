"""What is paid besides the task's own reward, applied where batches are drawn, never written into the environment."""
