"""The paper's experiment, on its own model and on a virtual robot: figures, tables and pages."""
