"""The whole loop: measured trials, traced effect, simulation, expert, disturbance, adaptation, export."""
