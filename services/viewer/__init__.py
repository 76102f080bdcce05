"""The viewer: a page in the browser that shows a cell live, or a recording of one."""
